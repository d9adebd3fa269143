"""A Markdown text as a page that needs no other file."""

_STYLE = (
    "body{font:16px/1.5 system-ui,sans-serif;max-width:64rem;margin:2rem auto;padding:0 1rem}"
    ".wide{overflow-x:auto}table{border-collapse:collapse}"
    "td,th{padding:.3rem .7rem;border-bottom:1px solid #ddd;text-align:left;"
    "overflow-wrap:anywhere;min-width:5rem}"
    "[style*=right]{white-space:nowrap;min-width:0}"
    "pre{white-space:pre-wrap;overflow-wrap:anywhere}img{max-width:100%}"
)


def markdown_page(title: str, text: str) -> str:
    """Return a text in Markdown, with tables and without HTML of its own, as an HTML page."""
    from markdown_it import MarkdownIt

    body = MarkdownIt("commonmark", {"html": False}).enable("table").render(text)
    body = body.replace("<table>", '<div class="wide"><table>')
    body = body.replace("</table>", "</table></div>")
    return (
        f'<!doctype html><html lang="en"><meta charset="utf-8"><title>{title}</title>'
        f"<style>{_STYLE}</style>{body}</html>\n"
    )
