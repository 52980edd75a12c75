"""Numbers and lists as a reader wants them."""

import pytest

from stiction_envs.reporting import markdown as md

NAN = float("nan")


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ([md.signed(x) for x in (-0.04, 0.04, -1.25, NAN)], ["0.0", "0.0", "−1.2", "–"]),
        ([md.number(x, 0) for x in (-0.4, 12.3, -6.0, NAN)], ["0", "12", "−6", "–"]),
        ([md.short(x) for x in (12345.6, 0.00123456, 0.0, NAN)], ["12346", "0.00123", "0", "–"]),
        ([md.span(x) for x in ([0.21, 0.2, 0.7], [38.01, 38.02])], ["0.20 to 0.70", "38"]),
        (md.listed([1, 2, 3]), "1, 2 and 3"),
        ([md.joints(x) for x in ([], [1], [1, 2])], ["no joint", "joint 1", "joints 1 and 2"]),
        ([md.sentence(x) for x in ("so it is", "Yes.")], ["So it is.", "Yes."]),
        (md.table_text(["a", "b"], [["1", "2"]]), "| a | b |\n|---|---|\n| 1 | 2 |\n"),
        (md.table_text(["a|b"], [["|x|"]]), "| a\\|b |\n|---|\n| \\|x\\| |\n"),
    ],
)
def test_text(text, expected):
    assert text == expected
