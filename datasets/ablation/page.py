"""An ablation's report as one HTML page, from its Markdown."""

from __future__ import annotations

from markdown_it import MarkdownIt

# Columns of numbers are aligned to the right and never wrap; the others may.
STYLE = (
    "body{font:16px/1.5 system-ui,sans-serif;max-width:64rem;margin:2rem auto;padding:0 1rem}"
    ".wide{overflow-x:auto}table{border-collapse:collapse}"
    "td,th{padding:.3rem .7rem;border-bottom:1px solid #ddd;text-align:left;"
    "overflow-wrap:anywhere;min-width:5rem}"
    "[style*=right]{white-space:nowrap;min-width:0}"
    "img{max-width:100%}"
)


def report_html(markdown: str, picture_name: str, picture_base64: str) -> str:
    """Return the report as a page that needs no other file.

    Args:
        markdown: The report.
        picture_name: File name of the picture in it.
        picture_base64: Content of the picture, a PNG file in base64.
    """
    body = MarkdownIt("commonmark", {"html": False}).enable("table").render(markdown)
    body = body.replace(f'src="{picture_name}"', f'src="data:image/png;base64,{picture_base64}"')
    body = body.replace("<table>", '<div class="wide"><table>').replace(
        "</table>", "</table></div>"
    )
    return (
        f'<!doctype html><html lang="en"><meta charset="utf-8"><title>Ablation</title>'
        f"<style>{STYLE}</style>{body}</html>\n"
    )
