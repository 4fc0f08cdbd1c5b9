# %% [markdown]
# # Where seedlings are lost
#
# A trial picks, carries and throws every seedling of a tray. This notebook runs trials on the simulated machine, counts
# the seedlings that each of the three steps loses, and repeats the trials with a fault in the supply of the claws.
# All numbers below are computed by the cells.

# %%
import matplotlib.pyplot as plt

from plant_sim.api import parse_fault, run_trial, trial_frame

SEEDS = range(1, 7)
SEEDLINGS = 72
LOST = ["P", "D", "T"]  # lost while picking, carrying and throwing

# %% [markdown]
# ## One trial
#
# The same seed gives the same trial. S is the success: the share of the seedlings that are in a cup at the end, with its
# exact binomial confidence limits.

# %%
report = run_trial(seed=SEEDS[0], seedlings=SEEDLINGS)
report

# %%
print(report.text())

# %% [markdown]
# ## A table with one row per trial

# %%
healthy = trial_frame(run_trial(seed=seed, seedlings=SEEDLINGS) for seed in SEEDS)
healthy[["seed", "seedlings", "in_cups", *LOST, "S", "S_low", "S_high", "cycle_time_s", "air_l_min"]].round(1)

# %%
total = healthy[LOST].sum()
print(
    f"{len(healthy)} trials of {SEEDLINGS} seedlings: S {100 * healthy.in_cups.sum() / healthy.seedlings.sum():.1f} %, "
    f"lost picking {total.P}, carrying {total.D}, throwing {total['T']}; most are lost in step {total.idxmax()}"
)

# %% [markdown]
# ## The same trials with a fault
#
# The regulator of the claws supplies less than its set pressure. A fault has a kind, a target, a size, and optionally a
# time; [all faults](../reference/faults.md) are listed with an example of each.

# %%
fault = parse_fault("low_claw_supply:supply=0.15MPa")
weak = trial_frame(run_trial(seed=seed, seedlings=SEEDLINGS, faults=[fault]) for seed in SEEDS)
weak[["seed", "in_cups", *LOST, "S", "completed", "alarms"]].round(1)

# %%
figure, axes = plt.subplots(figsize=(6, 3))
for shift, (name, frame) in zip((-0.2, 0.2), {"healthy": healthy, str(fault): weak}.items()):
    shares = 100 * frame[LOST].sum() / frame.seedlings.sum()
    axes.bar([number + shift for number in range(len(LOST))], shares, width=0.4, label=name)
axes.set_xticks(range(len(LOST)), ["picking (P)", "carrying (D)", "throwing (T)"])
axes.set_ylabel("lost seedlings, %")
axes.legend()
figure.tight_layout()

# %%
more = 100 * (weak[LOST].sum() / weak.seedlings.sum() - healthy[LOST].sum() / healthy.seedlings.sum())
print("change by the fault, percentage points: " + ", ".join(f"{step} {change:+.1f}" for step, change in more.items()))
