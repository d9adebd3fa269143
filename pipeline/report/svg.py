"""Plain SVG figures: curves of histograms, bars, a word cloud."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape

import numpy as np

# Distinguishable with every colour vision (Okabe and Ito, 2008).
COLORS = ("#2b5fb8", "#d55e00", "#009e73", "#cc79a7", "#8060d0", "#5c6878")


@dataclass(frozen=True)
class Plot:
    """An inline SVG and what it shows."""

    svg: str
    caption: str


_WIDTH, _HEIGHT = 540, 300
_LEFT, _RIGHT, _TOP, _BOTTOM = 64, 12, 34, 44
_SPIRAL = 2500  # places tried for a word


def step_histogram(
    values: Mapping[str, Sequence[float]],
    label: str,
    what: str,
    width: float | None = None,
    marks: Mapping[str, float] | None = None,
) -> str:
    """Return the histograms of several groups over the same bins, as shares of each group.

    Args:
        values: numbers by group.
        label: of the horizontal axis, with the unit.
        what: is counted.
        width: of a bin; those of width 1 stand about whole numbers. None chooses one for about
            fifteen bins.
        marks: vertical lines by name.
    """
    everything = [v for group in values.values() for v in group]
    if not everything:
        return _figure(['<text x="270" y="150" text-anchor="middle">no data</text>'])
    low, high = min(everything), max(everything)
    width = width or _round_step(max(high - low, 1e-9) / 15)
    whole = width == 1.0 and all(float(v).is_integer() for v in everything)
    shift = 0.5 if whole else 0.0  # bins of whole numbers stand about them
    first = math.floor(low / width + shift)
    edges = width * (np.arange(first, math.floor(high / width + shift) + 2) - shift)
    shares = {
        name: np.histogram(group, edges)[0] / len(group) for name, group in values.items() if group
    }
    top = max(float(share.max()) for share in shares.values()) * 1.08
    parts = _axes(edges[0], edges[-1], top, label, f"share of {what}", whole=whole)
    for (name, share), color in zip(shares.items(), _colors(shares), strict=True):
        points = [(edges[0], 0.0)]
        for k, value in enumerate(share):
            points += [(edges[k], value), (edges[k + 1], value)]
        points.append((edges[-1], 0.0))
        line = " ".join(f"{_x(x, edges[0], edges[-1]):.1f},{_y(y, top):.1f}" for x, y in points)
        title = f"{name}: {len(values[name])} {what}"
        parts.append(
            f'<polyline points="{line}" fill="{color}" fill-opacity="0.12" stroke="{color}" '
            f'stroke-width="2"><title>{escape(title)}</title></polyline>'
        )
    for name, value in (marks or {}).items():
        if edges[0] <= value <= edges[-1]:
            x = _x(value, edges[0], edges[-1])
            side, anchor = (4, "start") if x < _WIDTH / 2 else (-4, "end")
            parts.append(
                f'<line x1="{x:.1f}" y1="{_TOP}" x2="{x:.1f}" y2="{_HEIGHT - _BOTTOM}" '
                f'stroke="#5c6878" stroke-dasharray="4 3"/><text x="{x + side:.1f}" '
                f'y="{_TOP + 10}" text-anchor="{anchor}" fill="#5c6878">{escape(name)}</text>'
            )
    return _figure([*parts, *_legend(list(shares))])


def bars(shares: Mapping[str, Mapping[str, float]], label: str) -> str:
    """Return grouped bars: for each name one bar per group, with values in [0, 1].

    Args:
        shares: values by name, by group.
        label: of the vertical axis.
    """
    names = list(next(iter(shares.values()), {}))
    if not names:
        return _figure(['<text x="270" y="150" text-anchor="middle">no data</text>'])
    top = 1.08 * max(value for group in shares.values() for value in group.values())
    parts = _axes(0, len(names), max(top, 1e-9), "", label, ticks=False)
    slot = 0.8 / len(shares)
    for k, name in enumerate(names):
        x = _x(k + 0.5, 0, len(names))
        parts.append(
            f'<text x="{x:.1f}" y="{_HEIGHT - _BOTTOM + 18}" text-anchor="middle">'
            f"{escape(name)}</text>"
        )
        for g, (group, color) in enumerate(zip(shares, _colors(shares), strict=True)):
            value = shares[group][name]
            left = _x(k + 0.1 + g * slot, 0, len(names))
            right = _x(k + 0.1 + (g + 1) * slot, 0, len(names)) - 1
            y = _y(value, top)
            parts.append(
                f'<rect x="{left:.1f}" y="{y:.1f}" width="{right - left:.1f}" '
                f'height="{_HEIGHT - _BOTTOM - y:.1f}" fill="{color}">'
                f"<title>{escape(group)}: {100 * value:.1f} %</title></rect>"
            )
    return _figure([*parts, *_legend(list(shares))])


def word_cloud(counts: Mapping[str, int], most: int = 60) -> str:
    """Return the most frequent words, the larger the more frequent, packed along a spiral."""
    words = sorted(counts.items(), key=lambda item: (-item[1], item[0]))[:most]
    largest = words[0][1] if words else 1
    boxes: list[tuple[float, float, float, float]] = []
    parts = []
    for number, (word, count) in enumerate(words):
        size = 10 + 26 * (count / largest)
        half_x, half_y = 0.28 * size * len(word) + 2, 0.5 * size
        for k in range(_SPIRAL):
            angle, radius = 0.35 * k, math.sqrt(k / _SPIRAL)
            x = _WIDTH / 2 * (1 + radius * math.cos(angle))
            y = _HEIGHT / 2 * (1 + radius * math.sin(angle))
            box = (x - half_x, y - half_y, x + half_x, y + half_y)
            inside = box[0] > 2 and box[2] < _WIDTH - 2 and box[1] > 2 and box[3] < _HEIGHT - 2
            if inside and not any(_overlap(box, other) for other in boxes):
                boxes.append(box)
                color = COLORS[number % len(COLORS)]
                parts.append(
                    f'<text x="{x:.1f}" y="{y + 0.33 * size:.1f}" font-size="{size:.1f}" '
                    f'text-anchor="middle" fill="{color}" textLength="{2 * half_x - 4:.1f}" '
                    f'lengthAdjust="spacingAndGlyphs">{escape(word)}<title>{count}</title></text>'
                )
                break
    return _figure(parts)


def _overlap(a: tuple[float, ...], b: tuple[float, ...]) -> bool:
    return a[0] < b[2] and b[0] < a[2] and a[1] < b[3] and b[1] < a[3]


def _axes(
    low: float,
    high: float,
    top: float,
    label: str,
    y_label: str,
    *,
    ticks: bool = True,
    whole: bool = False,
) -> list[str]:
    bottom = _HEIGHT - _BOTTOM
    parts = [
        f'<line x1="{_LEFT}" y1="{bottom}" x2="{_WIDTH - _RIGHT}" y2="{bottom}" stroke="#9aa5b4"/>',
        f'<text x="{(_LEFT + _WIDTH - _RIGHT) / 2}" y="{_HEIGHT - 8}" text-anchor="middle">'
        f"{escape(label)}</text>",
        f'<text x="14" y="{(_TOP + bottom) / 2}" text-anchor="middle" '
        f'transform="rotate(-90 14 {(_TOP + bottom) / 2})">{escape(y_label)}</text>',
    ]
    if ticks:
        step = _round_step((high - low) / 8)
        step = max(1.0, step) if whole else step
        for k in range(math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9) + 1):
            x = _x(k * step, low, high)
            parts.append(
                f'<text x="{x:.1f}" y="{bottom + 16}" text-anchor="middle">{k * step:g}</text>'
            )
    step = _round_step(top / 4)
    for k in range(math.floor(top / step) + 1):
        y = _y(k * step, top)
        parts.append(
            f'<line x1="{_LEFT}" y1="{y:.1f}" x2="{_WIDTH - _RIGHT}" y2="{y:.1f}" '
            f'stroke="#d9dfe7"/><text x="{_LEFT - 6}" y="{y + 4:.1f}" text-anchor="end">'
            f"{100 * k * step:g} %</text>"
        )
    return parts


def _legend(names: Sequence[str]) -> list[str]:
    parts, x = [], float(_LEFT)
    for name, color in zip(names, _colors(names), strict=True):
        parts.append(
            f'<rect x="{x:.0f}" y="12" width="11" height="11" fill="{color}"/>'
            f'<text x="{x + 16:.0f}" y="22">{escape(name)}</text>'
        )
        x += 34 + 7.2 * len(name)
    return parts


def _colors(names: Sequence[str] | Mapping[str, object]) -> list[str]:
    return [COLORS[k % len(COLORS)] for k in range(len(names))]


def _x(value: float, low: float, high: float) -> float:
    return _LEFT + (value - low) / (high - low) * (_WIDTH - _LEFT - _RIGHT)


def _y(value: float, top: float) -> float:
    return _HEIGHT - _BOTTOM - value / top * (_HEIGHT - _TOP - _BOTTOM)


def _round_step(step: float) -> float:
    """Return the least of 1, 2, 5 × 10ⁿ that is not below `step`."""
    scale = 10.0 ** math.floor(math.log10(step))
    return next(m * scale for m in (1, 2, 5, 10) if m * scale >= step * (1 - 1e-9))


def _figure(parts: Sequence[str]) -> str:
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {_WIDTH} {_HEIGHT}" '
        f'width="{_WIDTH}" height="{_HEIGHT}" font-family="system-ui, sans-serif" font-size="12" '
        f'fill="#1c2430">{"".join(parts)}</svg>'
    )
