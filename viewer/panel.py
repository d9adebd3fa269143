"""What the viewer's panel says of a walk: text, events, curves."""

import html

import numpy as np
from viser import uplot

from ..formats.core.arrays import Array
from ..formats.core.rollout import Event
from .walk import Walk

HIGHLIGHT = "background:#ffe066;color:#000;padding:1px 2px;border-radius:3px"


def text_html(walk: Walk, part: int) -> str:
    """Return the instruction, with the part that is followed marked."""
    current = walk.parts[0][part]
    words = [html.escape(p) for p in walk.all_parts]
    marked = [
        f"<mark style='{HIGHLIGHT}'>{w}</mark>" if p == current and len(words) > 1 else w
        for p, w in zip(walk.all_parts, words, strict=True)
    ]
    end = walk.rollout.end_reason
    color = "#2b8a3e" if walk.rollout.metrics.success else "#c92a2a"
    title = f"{html.escape(walk.name)} · <b style='color:{color}'>{html.escape(end)}</b>"
    return padded(f"<small>{title}</small><br>{' '.join(marked)}", announced=True)


def padded(content: str, *, announced: bool = False) -> str:
    """Return HTML for the panel, which has no margins of its own.

    A change of what is announced is read out by screen readers.
    """
    style = "padding:0.2em 0.8em;font-size:0.88em;overflow-wrap:anywhere"
    role = " role='status'" if announced else ""
    return f"<div style='{style}'{role}>{content}</div>"


def event_name(event: Event) -> str:
    """Return an event's kind, with its detail if it has one."""
    return f"{event.kind}: {event.detail}" if event.detail else event.kind


def events_html(walk: Walk) -> str:
    """Return the table of a walk's events."""
    rows = "".join(
        f"<tr><td style='text-align:right;padding-right:0.6em'>{e.time_s:.2f} s</td>"
        f"<td>{html.escape(event_name(e))}</td></tr>"
        for e in walk.rollout.events
    )
    return padded(f"<table><caption>Events</caption>{rows}</table>")


SERIES = (
    uplot.Series(label="s"),
    uplot.Series(label="speed m/s", stroke="#1c7ed6", width=1.5, scale="y"),
    uplot.Series(label="tilt °", stroke="#e8590c", width=1.5, scale="tilt"),
    uplot.Series(label="event", stroke="#c92a2a", width=1, scale="mark"),
)
SCALES = {"x": uplot.Scale(time=False)}
AXES = (
    uplot.Axis(),
    uplot.Axis(scale="y", size=34),
    uplot.Axis(scale="tilt", side=1, size=34),
)


def curve_data(walk: Walk | None) -> tuple[Array, ...]:
    """Return time, speed, tilt, and 1 at events, at 20 Hz."""
    if walk is None:
        return (np.array([0.0, 1.0]), np.zeros(2), np.zeros(2), np.zeros(2))
    every = slice(None, None, 5)
    time_s = walk.rollout.time_s[every]
    marks = np.zeros(len(time_s))
    for event in walk.rollout.events:
        marks[min(len(marks) - 1, round(event.time_s * 20))] = 1
    return time_s, walk.speed_m_s[every], walk.tilt_deg[every], marks
