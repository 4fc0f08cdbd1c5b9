# %% [markdown]
# # A campaign over two factors
#
# Claw pressure and age of the seedlings are two of the three factors of the pepper paper. This notebook runs trials at
# every combination of their levels and draws the success over the pressure. Runs of hours belong into
# [campaigns in files](../campaigns.md), which can be interrupted; their rows have the same columns.
# All numbers below are computed by the cells.

# %%
import matplotlib.pyplot as plt

from plant_sim.api import campaign_frame

FACTORS = {
    "crop.claw_pressure_mpa": [0.25, 0.30, 0.35, 0.40, 0.45],
    "crop.seedling_age_d": [35, 40, 45],
}
REPLICATES = 3
SEED = 1
SEEDLINGS = 36
PRESSURE, AGE = FACTORS

# %% [markdown]
# ## One row per trial
#
# A row has the levels of the factors, the seed of its trial, and the results. The seeds of the trials follow from the seed
# of the campaign, so that the table is the same at every run, and with any number of processes (`workers`).

# %%
rows = campaign_frame(FACTORS, replicates=REPLICATES, seed=SEED, seedlings=SEEDLINGS)
print(f"{len(rows)} trials of {SEEDLINGS} seedlings, {rows.completed.sum()} complete")
rows[[PRESSURE, AGE, "trial", "in_cups", "P", "D", "T", "S", "S_low", "S_high"]].head(6).round({"S": 1, "S_low": 1, "S_high": 1})

# %% [markdown]
# ## Pooled by point
#
# The seedlings of all replicates are pooled before the share is computed.

# %%
pooled = rows.groupby([AGE, PRESSURE])[["seedlings", "in_cups", "P", "D", "T"]].sum()
pooled["S"] = 100 * pooled.in_cups / pooled.seedlings
pooled.S.unstack(AGE).round(1)

# %%
figure, axes = plt.subplots(figsize=(6, 3.5))
for age, group in pooled.S.groupby(AGE):
    axes.plot(group.index.get_level_values(PRESSURE), group, marker="o", label=f"{age:g} d")
axes.set_xlabel("claw pressure, MPa")
axes.set_ylabel("success S, %")
axes.legend(title="age of the seedlings")
figure.tight_layout()

# %%
age, pressure = pooled.S.idxmax()
print(f"highest success: {pooled.S.max():.1f} % at {pressure:g} MPa and {age:g} d, of {pooled.seedlings.max()} seedlings")
span = {name: pooled.S.groupby(name).mean() for name in FACTORS}
for name, means in span.items():
    print(f"{name}: mean S from {means.min():.1f} % to {means.max():.1f} % over its levels")
