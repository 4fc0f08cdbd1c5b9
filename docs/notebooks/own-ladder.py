# %% [markdown]
# # A ladder program of one's own
#
# Any FX2N program can replace the controller ([FX2N ladder](../ladder.md)). It sees the terminals of the machine only.
# This notebook writes a program with a mistake, lets the simulated plant tell it, and corrects one rung.
# All numbers below are computed by the cells.

# %%
from plant_sim.api import EndingRule, read_il, run_ladder_trial

SEED = 1
TRAYS = 1
LIMIT_S = 20  # machine time after which a trial ends

# %% [markdown]
# ## The program
#
# An instruction list: the tray is conveyed until its front edge is seen, and then the left arm moves to the tray. Nothing
# raises the arm before it moves.

# %%
PROGRAM = """
LD M8000
OUT Y21     ; tray stepper forward
LD M8000
ANI X15     ; until the front edge of the tray is seen,
OUT Y0      ; the tray stepper runs
LD X15
OUT Y5      ; left arm to the tray
END
"""
ladder = read_il(PROGRAM)
report = run_ladder_trial(ladder, seed=SEED, trays=TRAYS, rule=EndingRule(1000 * LIMIT_S))
report

# %%
print(f"{len(report.incidents)} incidents, {report.counts.ploughed} seedlings that the arm was driven through:")
print("\n".join(report.incidents))

# %% [markdown]
# ## One rung more
#
# The left lift is raised whenever the machine is on, so that the arm is above the tray when it moves.

# %%
corrected = read_il(PROGRAM.replace("LD X15\n", "LD M8000\nOUT Y2      ; left arm up\nLD X15\n"))
after = run_ladder_trial(corrected, seed=SEED, trays=TRAYS, rule=EndingRule(1000 * LIMIT_S))
after

# %%
print(f"incidents: {len(report.incidents)} before, {len(after.incidents)} after")
print(f"seedlings driven through: {report.counts.ploughed} before, {after.counts.ploughed} after")
print(f"seedlings untouched in the tray: {after.counts.in_tray - after.counts.ploughed} of {after.counts.total}")
