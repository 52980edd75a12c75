"""Print the README's table from a finished run: `python docs/make_table.py runs/panda`."""

import sys
from pathlib import Path

import numpy as np

from stiction_envs.measured.tables import read_amplitudes, read_sje
from stiction_envs.measured.thesis_tables import thesis_dithered, thesis_table

folder = Path(sys.argv[1])
verified = read_sje(folder / "verification.csv")
by_hand = {row["joint"]: row for row in thesis_table("4.9")}
final = [r for r in thesis_dithered("panda") if (r.table, r.amplitude_set) == ("4.10", "final")]
print("| joint | f [Hz] | A [N·m] | by hand: f, A | change, simulated | change, measured |")
print("|---|---|---|---|---|---|")
for row in read_amplitudes(folder / "final.csv", n_joints=7):
    thesis = by_hand[row.joint]
    ours = -100 * np.mean([v.reduction for v in verified if v.joint == row.joint])
    theirs = np.mean([r.change_pct for r in final if r.joint == row.joint])
    hand = f"{thesis['frequency_Hz']:g}, {abs(thesis['tau_final_Nm']):.2f}"
    changes = f"{ours:+.0f} % | {theirs:+.0f} %".replace("-", "−")
    print(f"| {row.joint} | {row.frequency_hz:g} | {row.amplitude_nm:.2f} | {hand} | {changes} |")
