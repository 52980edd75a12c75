from tests.cli.short_commands import few_settings, run_short, short_motion  # noqa: F401
