from tests.cli.short_commands import few_settings  # noqa: F401
from tests.cli.test_identify import base, mine  # noqa: F401
