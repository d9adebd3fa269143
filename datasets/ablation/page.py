"""An ablation's report as one HTML page, from its Markdown."""

from __future__ import annotations

import html


def report_html(markdown: str, picture_base64: str) -> str:
    """The same as one page that needs nothing else."""
    body = []
    for block in markdown.split("\n\n"):
        if block.startswith("#"):
            level = len(block) - len(block.lstrip("#"))
            body.append(f"<h{level}>{_inline(block.lstrip('# '))}</h{level}>")
        elif block.startswith("!["):
            body.append(f'<img alt="" src="data:image/png;base64,{picture_base64}">')
        elif block.startswith("|"):
            body.append(_html_table(block.splitlines()))
        elif block.startswith("- "):
            items = "".join(f"<li>{_inline(line[2:])}</li>" for line in block.splitlines())
            body.append(f"<ul>{items}</ul>")
        elif block.strip():
            body.append(f"<p>{_inline(block)}</p>")
    style = (
        "body{font:16px/1.5 system-ui,sans-serif;max-width:64rem;margin:2rem auto;padding:0 1rem}"
        ".wide{overflow-x:auto}table{border-collapse:collapse}"
        "td,th{padding:.3rem .7rem;border-bottom:1px solid #ddd;text-align:right;"
        "white-space:nowrap}"
        ".text{text-align:left;white-space:normal;overflow-wrap:anywhere;min-width:5rem}"
        "img{max-width:100%}"
    )
    return (
        f'<!doctype html><html lang="en"><meta charset="utf-8"><title>Ablation</title>'
        f"<style>{style}</style>{''.join(body)}</html>\n"
    )


def _inline(text: str) -> str:
    parts = html.escape(text).split("**")
    return "".join(f"<b>{p}</b>" if n % 2 else p for n, p in enumerate(parts))


def _html_table(lines: list[str]) -> str:
    """Columns of numbers are those whose rule ends in a colon; only the others may wrap."""
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]
    text = [not rule.endswith(":") for rule in rows[1]]

    def line(kind: str, cells: list[str]) -> str:
        return "".join(
            f"<{kind}{' class=text' * words}>{_inline(cell)}</{kind}>"
            for cell, words in zip(cells, text, strict=True)
        )

    body = "".join(f"<tr>{line('td', row)}</tr>" for row in rows[2:])
    return f'<div class="wide"><table><tr>{line("th", rows[0])}</tr>{body}</table></div>'
