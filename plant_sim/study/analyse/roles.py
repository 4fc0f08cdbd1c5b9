"""Roles of the columns of a table of trials: response, factors, blocks, whole plots; given by name or guessed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from plant_sim.study.analyse.kinds import MOST_LABELS, KindFactor, read_kind
from plant_sim.study.analyse.table import TrialColumn, TrialTable
from plant_sim.study.doe.block_columns import block_columns
from plant_sim.study.doe.design import Factor, to_coded
from plant_sim.study.errors import StudyError

Best = Literal["high", "low"]

_COUNTED: Final = ("lost", "loss", "fail", "injur", "damag", "missed", "lodg", "损失", "失败", "漏", "伤", "掉", "倒")
_TOTALS: Final = ("total", "seedlings", "trials n", "总数", "株数", "总株", "苗数")
_BLOCKS: Final = ("block", "date", "day", "batch", "operator", "区组", "日期", "批", "操作")
_IDS: Final = frozenset(
    (
        *("run", "trial", "no", "no.", "nr", "order", "number", "id", "remark", "remarks", "note", "notes"),
        *("provenance", "序号", "编号", "试验号", "试验", "顺序", "备注"),
    )
)
_MOST_FACTORS = 12
_FEWEST_CORNER_LEVELS = 5
_ROUNDING = 1e-6


@dataclass(frozen=True, slots=True)
class RoleOptions:
    """Names of columns by role, as given; None for a guess.

    Attributes:
        response: Column of a measured value.
        counts: Column of counted seedlings.
        total: Column with the seedlings of each trial, or their number.
        factors: Columns of factors.
        categorical: Factors whose levels are names, also if these are numbers.
        blocks: Columns of blocks; empty for none.
        whole_plots: Column that numbers the whole plots, in each of which the factors hard to change stay the same.
        hard: Factors hard to change, if no column numbers their whole plots.
        best: Whether a high or a low response is good; None: low for counts, else high.
    """

    response: str | None = None
    counts: str | None = None
    total: str | None = None
    factors: tuple[str, ...] | None = None
    categorical: tuple[str, ...] = ()
    blocks: tuple[str, ...] | None = None
    whole_plots: str | None = None
    hard: tuple[str, ...] = ()
    best: Best | None = None


@dataclass(frozen=True)
class Trials:
    """Trials of a table, ready for the fit.

    Attributes:
        table: Table.
        factors: Coding of each numeric factor, numbered from 1.
        kinds: Categorical factors, numbered after the numeric ones.
        coded: Coded levels, trials x numeric factors.
        label: Response and its unit.
        response: Response of each trial: the value, or the share of counted seedlings, %.
        counts: Counted seedlings of each trial; None for a value.
        totals: Seedlings of each trial; None for a value.
        blocks: Labels of the blocks of each trial, by the name of their column.
        plots: Label of the whole plot of each trial; None without whole plots.
        hard: Numbers of the factors that are hard to change, from 1.
        best: Whether a high or a low response is good.
        roles: Sentence that states the role of every column.
    """

    table: TrialTable
    factors: tuple[Factor, ...]
    kinds: tuple[KindFactor, ...]
    coded: NDArray[np.float64]
    label: str
    response: NDArray[np.float64]
    counts: NDArray[np.float64] | None
    totals: NDArray[np.float64] | None
    blocks: dict[str, tuple[str, ...]]
    plots: tuple[str, ...] | None
    hard: tuple[int, ...]
    best: Best
    roles: str

    @property
    def columns(self) -> NDArray[np.float64]:
        """Columns of all factors for the model matrix: coded levels, then those of the categorical factors."""
        return np.hstack([self.coded, *(each.columns for each in self.kinds)])

    @property
    def owners(self) -> tuple[int, ...]:
        """Number of the factor of each of the `columns`."""
        numeric = len(self.factors)
        kinds = (number for number, each in enumerate(self.kinds, numeric + 1) for _ in range(each.columns.shape[1]))
        return (*range(1, numeric + 1), *kinds)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all factors, in the order of their numbers."""
        return (*(each.name for each in self.factors), *(each.name for each in self.kinds))

    @property
    def codes(self) -> NDArray[np.float64]:
        """Levels of all factors as numbers, trials x factors: coded, or the number of the level."""
        return np.column_stack([self.coded, *(each.codes for each in self.kinds)])

    @property
    def block_columns(self) -> NDArray[np.float64]:
        """Columns of the blocks for the model matrix."""
        return np.hstack([np.empty((len(self.coded), 0)), *map(block_columns, self.blocks.values())])


def assign(table: TrialTable, options: RoleOptions) -> Trials:
    """Return the trials of a table with the roles of its columns.

    Args:
        table: The table.
        options: Given names; roles without a name are guessed from the headings.

    Raises:
        StudyError: A column does not exist or does not fit its role, or the guess finds none; the message is one line.
    """
    options, guessed = _guess(table, options)
    counts = totals = None
    if options.counts is not None:
        column = table.column(options.counts, "--counts")
        counts, totals = _counts(table, column, options.total)
        response, label = 100 * counts / totals, f"{column.name}, %"
    else:
        column = table.column(options.response or "", "--response")
        response = np.array(table.numbers(column))
        label = column.name if column.unit == "-" else f"{column.name}, {column.unit}"
    columns = [table.column(name, "--factors") for name in options.factors or ()]
    if not 1 <= len(columns) <= _MOST_FACTORS:
        raise StudyError(f"--factors: {len(columns)} factors; name 1 to {_MOST_FACTORS} columns of {table.path}")
    named = _categorical(table, columns, options)
    numeric = [each for each in columns if each.name not in named and table.is_numeric(each)]
    kinds = tuple(read_kind(table, each, is_named=each.name in named) for each in columns if each not in numeric)
    levels = np.array([table.numbers(each) for each in numeric]).reshape(len(numeric), len(table.lines)).T
    factors = tuple(_coding(table, each, own) for each, own in zip(numeric, levels.T, strict=True))
    columns = [*numeric, *(each for each in columns if each not in numeric)]
    blocks = {
        each.name: tuple(table.texts(each))
        for each in (table.column(name, "--blocks") for name in options.blocks or ())
    }
    for name, labels in blocks.items():
        if len(set(labels)) == 1:
            raise StudyError(f"--blocks {name}: has one block only; omit it")
        for column in columns:
            if _stays(column, labels):
                raise StudyError(
                    f"--blocks {name}: {column.name} stays the same within every block, so their effects cannot be "
                    f"separated; use --whole-plots {name}"
                )
    plots = (
        None if options.whole_plots is None else tuple(table.texts(table.column(options.whole_plots, "--whole-plots")))
    )
    return Trials(
        table=table,
        factors=factors,
        kinds=kinds,
        coded=to_coded(factors, levels),
        label=label,
        response=response,
        counts=counts,
        totals=totals,
        blocks=blocks,
        plots=plots,
        hard=_hard(table, columns, np.column_stack([levels, *(each.codes for each in kinds)]), plots, options),
        best=options.best or ("high" if options.counts is None else "low"),
        roles=_sentence(table, options, guessed),
    )


def _guess(table: TrialTable, options: RoleOptions) -> tuple[RoleOptions, bool]:
    """Return the options with every role that was not given guessed from headings and cells."""
    if options.response is not None and options.counts is not None:
        raise StudyError("--response, --counts: exclude each other; name a value or a count")
    used = {
        options.response,
        options.counts,
        options.total,
        options.whole_plots,
        *(options.factors or ()),
        *(options.blocks or ()),
    }
    free = [each for each in table.columns if each.name not in used]
    given = options
    if options.counts is None and options.response is None:
        options = replace(options, counts=_named(table, free, _COUNTED))
    if options.counts is not None and options.total is None:
        options = replace(options, total=_named(table, free, _TOTALS))
        if options.total is None:
            raise StudyError("--total: is missing; name the column with the seedlings of each trial, or their number")
    if options.counts is None and options.total is not None and given.total is not None:
        raise StudyError("--total: has no effect without --counts; omit it, or name the counted seedlings")
    taken = {options.counts, options.total}
    free = [each for each in free if each.name not in taken and each.name.lower() not in _IDS]
    labels = [each for each in free if _has_word(each, _BLOCKS) and len(set(each.cells)) > 1]
    free = [each for each in free if not _has_word(each, _BLOCKS)]
    if options.counts is None and options.response is None:
        numeric = [each for each in free if table.is_numeric(each)]
        if len(numeric) < (1 if options.factors else 2):
            raise StudyError(f"--response: {table.path} has no column for it; name the columns with options")
        options = replace(options, response=numeric[-1].name)
        free = [each for each in free if each.name != options.response]
    if options.factors is None:
        options = replace(options, factors=tuple(each.name for each in free if _varies(table, each)))
    if options.blocks is None:
        factors = [each for each in table.columns if each.name in (options.factors or ())]
        plots = [each.name for each in labels if any(_stays(factor, each.cells) for factor in factors)]
        options = replace(options, blocks=tuple(each.name for each in labels if each.name not in plots))
        if plots and options.whole_plots is None and not options.hard:
            options = replace(options, whole_plots=plots[0])
    return options, options != given


def _named(table: TrialTable, columns: Sequence[TrialColumn], words: Sequence[str]) -> str | None:
    """Return the first numeric column whose name contains one of the words."""
    return next((each.name for each in columns if _has_word(each, words) and table.is_numeric(each)), None)


def _has_word(column: TrialColumn, words: Sequence[str]) -> bool:
    return any(word in column.name.lower() for word in words)


def _varies(table: TrialTable, column: TrialColumn) -> bool:
    """Return whether a column is probably a factor: numbers, or a few names that are repeated."""
    distinct = len(set(column.cells))
    return distinct > 1 and (table.is_numeric(column) or distinct <= min(MOST_LABELS, len(column.cells) // 2))


def _categorical(table: TrialTable, columns: Sequence[TrialColumn], options: RoleOptions) -> tuple[str, ...]:
    """Return the names of the factors that the user says are categorical."""
    names = tuple(table.column(name, "--categorical").name for name in options.categorical)
    for name in names:
        if name not in [each.name for each in columns]:
            raise StudyError(f"--categorical {name}: is not a factor; name it with --factors, too")
    return names


def _stays(factor: TrialColumn, groups: Sequence[str]) -> bool:
    """Return whether a factor stays the same within every group, and groups have more than one trial."""
    return len(set(zip(groups, factor.cells, strict=True))) == len(set(groups)) < len(groups)


def _counts(
    table: TrialTable, column: TrialColumn, total: str | None
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return counts and totals of the trials."""
    counts = np.array(table.counts(column), dtype=np.float64)
    text = total or ""
    if text.isdecimal() and int(text) > 0 and text not in [each.name for each in table.columns]:
        totals, named = np.full(len(counts), float(text)), f"--total {text}"
    else:
        other = table.column(text, "--total")
        totals, named = np.array(table.counts(other), dtype=np.float64), other.name
    for line, count, each in zip(table.lines, counts, totals, strict=True):
        if each < 1 or count > each:
            raise table.error(line, column, f"{count:g} of {each:g} ({named}) is impossible; correct one of them")
    return counts, totals


def _coding(table: TrialTable, column: TrialColumn, levels: NDArray[np.float64]) -> Factor:
    """Return the coding of a factor: its range is -1 to 1, or the corners if it has the five levels of a composite."""
    distinct = np.unique(levels)
    if len(distinct) == 1:
        raise StudyError(
            f"{table.path}: column {column.name}: is {distinct[0]:g} in every trial, so it is no factor; "
            "name the factors with --factors"
        )
    centre, step = (distinct[0] + distinct[-1]) / 2, (distinct[-1] - distinct[0]) / 2
    is_symmetric = np.allclose(distinct + distinct[::-1], 2 * centre, atol=_ROUNDING * step)
    if len(distinct) == _FEWEST_CORNER_LEVELS and is_symmetric:
        step = distinct[3] - centre
    return Factor(column.name, column.unit, float(centre), float(step))


def _hard(
    table: TrialTable,
    columns: Sequence[TrialColumn],
    levels: NDArray[np.float64],
    plots: tuple[str, ...] | None,
    options: RoleOptions,
) -> tuple[int, ...]:
    """Return the numbers of the factors that stay the same within every whole plot, or that were named."""
    if plots is None:
        names = [each.name for each in columns]
        wanted = [table.column(name, "--hard").name for name in options.hard]
        for name in wanted:
            if name not in names:
                raise StudyError(f"--hard {name}: is not a factor; name one of {', '.join(names)}")
        return tuple(names.index(name) + 1 for name in wanted)
    if options.hard:
        raise StudyError("--hard: has no effect with --whole-plots, which shows the factors; omit it")
    labels = np.array(plots)
    same = [
        number
        for number, own in enumerate(levels.T, 1)
        if all(len(np.unique(own[labels == plot])) == 1 for plot in set(plots))
    ]
    if not same:
        raise StudyError(
            f"--whole-plots {options.whole_plots}: every factor changes within a whole plot; use --blocks instead"
        )
    return tuple(same)


def _sentence(table: TrialTable, options: RoleOptions, guessed: bool) -> str:
    """Return the sentence about the roles of the columns."""
    response = f"value {options.response}" if options.counts is None else f"{options.counts} of {options.total}"
    rest = {
        "factors": options.factors or (),
        "blocks": options.blocks or (),
        "whole plots": () if options.whole_plots is None else (options.whole_plots,),
    }
    named = {options.response, options.counts, options.total, *(name for names in rest.values() for name in names)}
    unused = [each.name for each in table.columns if each.name not in named]
    listed = [f"response: {response}", *(f"{role}: {', '.join(names)}" for role, names in rest.items() if names)]
    if unused:
        listed.append(f"not used: {', '.join(unused)}")
    how = (
        "Roles of the columns, guessed from their headings (change them with --counts, --total, --response, --factors, "
        "--categorical, --blocks, --whole-plots)"
        if guessed
        else "Roles of the columns, as given"
    )
    return f"{how}: {'; '.join(listed)}."
