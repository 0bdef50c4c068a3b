"""Small tables and figures for notebooks."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from typing import Any

import numpy as np

_COLORS = {"measured": "#888888", "before": "#333333", "after": "#0b62a4"}


def table(header: Sequence[str], rows: Sequence[Sequence[Any]]) -> str:
    """A table."""

    def cell(value: Any) -> str:
        if isinstance(value, float):
            return f"<td style='text-align:right'>{value:.4g}</td>"
        return f"<td>{escape(str(value))}</td>"

    head = "".join(f"<th>{escape(h)}</th>" for h in header)
    body = "".join(f"<tr>{''.join(cell(v) for v in row)}</tr>" for row in rows)
    return f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"


def moments(name: str, time: Any, curves: Sequence[tuple[str, Any, str]]) -> str:
    """Moments over time as an SVG.

    Args:
        name: Above the figure.
        time: Times [s].
        curves: Label, moment [N·m], and whether it is measured, before or after.
    """
    width, height, left, bottom, top = 300, 150, 38, 18, 18
    t = np.asarray(time, float)
    every = max(1, len(t) // 150)
    values = np.concatenate([np.asarray(c, float) for _, c, _ in curves])
    low, high = float(np.nanmin(values)), float(np.nanmax(values))
    if high - low < 1e-9:
        low, high = low - 1, high + 1
    x = left + (t - t[0]) / (t[-1] - t[0]) * (width - left - 4)

    def y(v: Any) -> Any:
        return top + (high - np.asarray(v, float)) / (high - low) * (height - top - bottom)

    parts = [f"<text x='{left}' y='12'>{escape(name)}</text>"]
    for value in (low, high):
        parts.append(f"<text x='{left - 4}' y='{y(value) + 4:.1f}' text-anchor='end'>{value:.1f}</text>")
    parts.append(f"<text x='{width - 4}' y='{height - 4}' text-anchor='end'>{t[-1] - t[0]:.1f} s</text>")
    for label, curve, kind in curves:
        points = " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(x[::every], y(curve)[::every], strict=True))
        dash = " stroke-dasharray='4 3'" if kind == "before" else ""
        parts.append(
            f"<polyline points='{points}' fill='none' stroke='{_COLORS[kind]}' stroke-width='1.4'{dash}>"
            f"<title>{escape(label)}</title></polyline>"
        )
    style = "font:11px sans-serif;background:#fff;margin:2px"
    return f"<svg width='{width}' height='{height}' style='{style}' role='img'>{''.join(parts)}</svg>"
