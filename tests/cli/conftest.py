from tests.cli.short_commands import log, short_motion  # noqa: F401
