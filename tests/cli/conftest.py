from tests.cli.short_commands import short_motion  # noqa: F401
