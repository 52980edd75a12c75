from tests.cli.short_commands import few_settings  # noqa: F401
