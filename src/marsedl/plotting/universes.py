"""Pictures of what universes say of a paper's claims."""

import textwrap
from collections.abc import Sequence

import numpy as np

from marsedl.plotting.style import BLACK, BLUE, GREY, ORANGE, VERMILION, new_figure
from marsedl.replication.claims.names import AGREEING_VERDICTS, REFUTED_VERDICTS
from marsedl.replication.claims.printed import PublishedClaim
from marsedl.replication.inputs.choices import Choice, Value, in_words
from marsedl.replication.universes.judging import Judge
from marsedl.replication.universes.waves import Matching, Wave

COLOURS = {"reproduced or holds": BLUE, "undetermined": GREY, "differs or fails": VERMILION}
SHOWN = 6  # choices below a specification curve
SMALL = 8  # points, of the smallest text
LARGEST_SIZE = 30.0  # of a change in the heat map's colours


def specification_curve(judge: Judge, claim: str, title: str):
    """Draw the values of a claim over all universes, sorted, with the choices that decide it below.

    Every point is a universe, coloured by its verdict; the line is what is printed, or the limit of a statement.
    """
    judged, table, found = judge.judged(claim), judge.table, judge.of[claim]
    values, errors_of, limits_of = found.numbers[:, :, found.deciding]
    order = [k for k in np.argsort(values, kind="stable") if np.isfinite(values[k])]
    verdicts = found.verdicts[order]
    shown = _shown(judge, judged.alone, judged.together, [one.choice for one in judged.indices])
    rows = [(one, value) for one in shown for value in ([None] if one.range else list(one.alternatives))]
    figure, axes = new_figure(
        6.4, 2.4 + 0.2 * len(rows), nrows=2, sharex=True, height_ratios=(2.2, max(0.2 * len(rows), 0.4))
    )
    x = np.arange(len(order))
    groups = {
        "reproduced or holds": np.isin(verdicts, AGREEING_VERDICTS),
        "differs or fails": np.isin(verdicts, REFUTED_VERDICTS),
    }
    groups["undetermined"] = ~np.any(list(groups.values()), axis=0)
    for label, those in groups.items():
        if those.any():
            at = np.array(order)[those]
            errors = np.nan_to_num(errors_of[at])
            name = f"{label} ({those.sum()})"
            axes[0].errorbar(x[those], values[at], errors, fmt=".", ms=4, lw=0.6, color=COLOURS[label], label=name)
    limits = np.unique(limits_of[order]) if len(order) else []
    if len(limits) == 1:
        axes[0].axhline(limits[0], color=BLACK, lw=0.9, label="limit" if found.is_statement else "printed")
    if judge.base in order:
        axes[0].plot(order.index(judge.base), values[judge.base], "o", mfc="none", mec=BLACK, ms=7, label="corrected")
    typical = np.percentile(np.abs(values[order]), 80) if order else 0.0
    if order and 0.0 < 8.0 * typical < np.abs(values[order]).max():
        axes[0].set_yscale("symlog", linthresh=typical)
    axes[0].set_title(title)
    axes[0].set_ylabel(_named(found.claim))
    if axes[0].get_legend_handles_labels()[0]:
        axes[0].legend(loc="best")
    _dots(axes[1], judge, rows, order)
    axes[1].set_xlabel(f"universes, sorted by value ({len(table.number) - len(order)} without a value)")
    return figure


def _named(published: PublishedClaim) -> str:
    """What the numbers of a claim are, with their unit: what decides a statement, or the quantity that is printed."""
    if published.kind == "qualitative":
        return "measure that decides"
    units = {*published.unit.split(", ")} - {"1"}
    return textwrap.fill(f"{published.quantity}{f' ({units.pop()})' if len(units) == 1 else ''}", 36)


def _shown(judge: Judge, *orders: Sequence[str]) -> list[Choice]:
    names = [name for order in orders for name in order if " x " not in name]
    by_name = judge.choices.by_name
    return [by_name[name] for name in dict.fromkeys([*names, *by_name])][:SHOWN]


def _dots(axes, judge: Judge, rows: list[tuple[Choice, Value | None]], order: list[int]) -> None:
    """Choices as dots: one row a value; of a range, the share of it that a universe has as the dot's height."""
    names = [one.name for one in judge.choices]
    labels = []
    for k, (one, value) in enumerate(rows):
        numbers = judge.table.assignment[order, names.index(one.name)]
        if one.range:
            shares = np.array([one.range.share(number) if np.isfinite(number) else np.nan for number in numbers])
            axes.plot(np.arange(len(order)), k + 0.4 - 0.8 * shares, ".", ms=2.5, color=ORANGE)
            labels.append(f"{in_words(one.name)}: {one.range.low:g} to {one.range.high:g}")
        else:
            at = np.flatnonzero(numbers == list(one.alternatives).index(value))
            axes.plot(at, np.full(len(at), k), "|", ms=5, color=BLUE)
            labels.append(f"{in_words(one.name)}: {in_words(value)}")
    axes.set_yticks(np.arange(len(rows)), labels, fontsize=SMALL)
    axes.set_ylim(len(rows) - 0.4, -0.6)
    axes.grid(visible=False, axis="x")


def tornado(judge: Judge, claim: str, title: str):
    """Draw how far each value of each choice, by itself, moves a claim's number towards what is printed, or away."""
    effects = [one for one in judge.effects(claim) if np.isfinite(one.size) and one.counts]
    names = list(dict.fromkeys(one.choice for one in effects))[:12]
    figure, axes = new_figure(6.4, 1.3 + 0.5 * max(len(names), 1))
    for k, name in enumerate(names):
        bars = sorted((one for one in effects if one.choice == name), key=lambda one: -one.size)
        for place, one in enumerate(bars):
            size = min(one.size, LARGEST_SIZE) * (1.0 if one.towards else -1.0)
            turned = _turns(judge.verdict(claim), one.verdict)
            axes.barh(k, size, height=0.5, color=BLUE if one.towards else VERMILION, alpha=0.55)
            height = k - 0.33 if place % 2 else k + 0.33
            text = f"{in_words(one.value)}{' (turns it)' if turned else ''}"
            axes.annotate(text, (size, height), ha="center", va="center", fontsize=SMALL)
    axes.set_xscale("symlog", linthresh=1.0)
    axes.set_xlim(-2 * LARGEST_SIZE, 2 * LARGEST_SIZE)
    axes.axvline(0.0, color=BLACK, lw=0.8)
    axes.set_yticks(np.arange(len(names)), [in_words(name) for name in names])
    axes.set_ylim(max(len(names), 1) - 0.4, -0.6)
    axes.set_xlabel("change over noise and rounding: away from what is printed (left), towards it (right)")
    axes.set_title(title)
    return figure


def heat_map(judge: Judge, claims: Sequence[str]):
    """Draw how large the effect of each choice on each claim is by itself; a dot marks a verdict that turns."""
    choices = list(judge.choices)
    sizes, turned, kept = [], [], []
    for claim in claims:
        effects = judge.effects(claim)
        row = [
            max((e.size for e in effects if e.choice == one.name and np.isfinite(e.size)), default=np.nan)
            for one in choices
        ]
        turns = [
            any(e.choice == one.name and _turns(judge.verdict(claim), e.verdict) for e in effects) for one in choices
        ]
        if np.nanmax([*row, 0.0]) > 1.0 or any(turns):
            sizes.append(row)
            turned.append(turns)
            kept.append(claim)
    figure, axes = new_figure(3.0 + 0.26 * len(choices), 2.2 + 0.19 * max(len(kept), 1))
    if kept:
        shown = np.log10(np.clip(np.nan_to_num(sizes), 0.1, LARGEST_SIZE))
        image = axes.imshow(shown, cmap="Blues", aspect="auto", vmin=-1.0, vmax=np.log10(LARGEST_SIZE))
        y, x = np.nonzero(turned)
        axes.plot(x, y, "o", ms=3.5, color=VERMILION)
        bar = figure.colorbar(image, ax=axes, ticks=[-1, 0, 1], shrink=0.6)
        bar.set_ticklabels(["0.1", "1", "10"])
        bar.set_label("change over noise and rounding")
    names = [in_words(one.name) for one in choices]
    axes.set_xticks(np.arange(len(choices)), names, rotation=60, ha="right", fontsize=SMALL)
    axes.set_yticks(np.arange(len(kept)), [in_words(one) for one in kept], fontsize=SMALL)
    axes.grid(visible=False)
    axes.set_title("dots: the verdict turns")
    return figure


def _turns(before: str, after: str) -> bool:
    return (before in AGREEING_VERDICTS and after in REFUTED_VERDICTS) or (
        before in REFUTED_VERDICTS and after in AGREEING_VERDICTS
    )


def pictures(judge: Judge, matching: Matching) -> list:
    """Return the heat map, what is left of the choices, and curve and tornado of each headline in turn."""
    drawn = [heat_map(judge, list(judge.of)), closing_in(matching.waves, matching.varied)]
    for claim in matching.headlines:
        title = claim.plain or in_words(claim.id)
        if claim.id in judge.of:
            drawn += [specification_curve(judge, claim.id, title), tornado(judge, claim.id, title)]
        else:
            drawn += [nothing(f"{title}\nis a claim on the method, which no universe evaluates")] * 2
    return drawn


def nothing(text: str):
    """Draw a sentence in place of a picture that cannot be drawn."""
    figure, axes = new_figure(6.4, 1.0)
    axes.axis("off")
    axes.text(0.5, 0.5, text, ha="center", va="center", wrap=True)
    return figure


def closing_in(waves: Sequence[Wave], choices: Sequence[Choice]):
    """Draw how much of the space of choices each wave leaves, and what values the last one leaves of each choice."""
    figure, axes = new_figure(6.4, 1.6 + 0.24 * len(choices), ncols=2, width_ratios=(1.0, 1.6))
    volumes = [100.0 * wave.volume for wave in waves]
    bars = axes[0].bar(np.arange(len(waves)), volumes, color=BLUE)
    axes[0].bar_label(bars, [f"{volume:.3g} %" for volume in volumes], fontsize=SMALL)
    axes[0].set(ylim=(0.0, 110.0), xticks=np.arange(len(waves)), xlim=(-0.8, max(len(waves), 3) - 0.2))
    axes[0].set_xlabel("wave (0 fills the space)")
    axes[0].set_ylabel("share of the choices that is not ruled out (%)")
    for k, one in enumerate(choices):
        left = 0.0
        for share in waves[-1].shares.get(one.name, []):
            axes[1].barh(k, share, left=left, height=0.7, color=BLUE, alpha=0.25 + 0.75 * share, ec="white", lw=0.8)
            left += share
    if not waves[-1].volume:
        axes[1].text(0.5, 0.5, "no choices are left", transform=axes[1].transAxes, ha="center")
    axes[1].set_xlim(0.0, 1.0)
    axes[1].set_yticks(np.arange(len(choices)), [in_words(one.name) for one in choices], fontsize=SMALL)
    axes[1].set_ylim(len(choices) - 0.4, -0.6)
    axes[1].set_xlabel("values among what is left, in their order")
    axes[1].grid(visible=False)
    return figure
