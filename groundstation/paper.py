"""White paper for what is handed on: one self-contained HTML page, nothing fetched, fit to print."""

import base64
from collections.abc import Sequence
from html import escape
from pathlib import Path

FONTS = Path(__file__).parent / "web" / "fonts"
STYLE = """
*{box-sizing:border-box} body{font:15px/1.45 Inter,"DejaVu Sans",sans-serif;color:#13202c;max-width:900px;
margin:40px auto;padding:0 26px;font-variant-numeric:tabular-nums;background:#fff}
h1{font-size:37px;line-height:1.12;letter-spacing:-.025em;margin:0 0 5px} .about{color:#455563;margin:0 0 16px}
.verdict{font-size:20px;line-height:1.4;margin:0 0 24px} .bad{color:#b4182d}
.five{display:grid;grid-template-columns:repeat(5,1fr);border-top:2px solid #13202c;border-bottom:1px solid #d5dbe1;
margin-bottom:24px} .five div{padding:10px 12px 11px 18px;border-left:1px solid #d5dbe1}
.five div:first-child{padding-left:0;border:0} .five b{display:block;font-size:27px;letter-spacing:-.02em}
.five span{color:#455563;font-size:13.5px} figure{margin:0 0 26px} figure img{width:100%;display:block}
figcaption{font-size:14px;color:#455563;margin-top:7px} figcaption b{color:#13202c}
.note{color:#455563;font-size:13.5px}
.narrow img{width:70%;margin:0 auto} h2{font-size:18px;margin:26px 0 4px;letter-spacing:-.01em}
table{border-collapse:collapse;width:100%;margin:4px 0 10px}
th,td{text-align:right;padding:6px 0 6px 14px;border-bottom:1px solid #e3e8ed;vertical-align:top}
th:first-child,td:first-child{text-align:left;padding-left:0} th.words,td.words{text-align:left}
th{color:#455563;font-weight:600;font-size:13px;border-bottom:1.5px solid #13202c;vertical-align:bottom}
td{white-space:nowrap} td.words{white-space:normal} tr.sum td{font-weight:600;border-top:1.5px solid #13202c}
.pair{display:grid;grid-template-columns:1.18fr 1fr;gap:0 40px}
.share{display:flex;height:15px;margin:2px 0 7px;border:1px solid #13202c} .share i{display:block;height:100%}
.key{display:flex;flex-wrap:wrap;gap:3px 18px;font-size:13.5px;color:#455563;margin:0 0 12px}
.key i{display:inline-block;width:13px;height:13px;margin-right:6px;vertical-align:-2px;border:1px solid #13202c}
footer{color:#5c6b78;font-size:12.5px;border-top:1px solid #d5dbe1;padding-top:9px;margin-top:30px;display:flex;
justify-content:space-between;gap:20px}
@page{size:A4;margin:16mm 15mm} @media print{body{margin:0;padding:0;max-width:none;font-size:13px}
h1{font-size:30px}.verdict{font-size:16px}figure,tr,.pair{break-inside:avoid}h2{break-after:avoid}}
@media (max-width:640px){.pair{display:block}.five{grid-template-columns:repeat(2,1fr)}}
"""
FILLS = (
    "#0b5cad", "repeating-linear-gradient(45deg,#5b9bda 0 3px,#fff 3px 6px)", "#9cc3e8", "#b45309",
    "repeating-linear-gradient(135deg,#13202c 0 2px,#fff 2px 6px)", "#7b8995", "#13202c",
    "repeating-linear-gradient(0deg,#b45309 0 2px,#fff 2px 5px)", "#e3e8ed",
)  # fmt: skip
"""Told apart without colour, too."""


def document(title: str, body: Sequence[str]) -> bytes:
    """The whole page; the parts of ``body`` are HTML."""
    head = f'<!doctype html><html lang="en"><meta charset="utf-8"><title>{escape(title)}</title>'
    return f"{head}<style>{_fonts()}{STYLE}</style><body>{''.join(body)}</body></html>\n".encode()


def _fonts() -> str:
    faces = []
    for script, extra in (("latin", ""), ("greek", ";unicode-range:U+0370-03FF")):
        content = base64.b64encode((FONTS / f"inter-{script}-wght-normal.woff2").read_bytes()).decode()
        source = f'url(data:font/woff2;base64,{content}) format("woff2")'
        faces.append(f"@font-face{{font-family:Inter;src:{source};font-weight:100 900{extra}}}")
    return "".join(faces)


def image(path: Path, number: int, caption: str, kind: str = "") -> str:
    """A PNG of its own, with its number and caption."""
    content = base64.b64encode(path.read_bytes()).decode()
    return (
        f'<figure class="{kind}"><img alt="{escape(caption)}" src="data:image/png;base64,{content}">'
        f"<figcaption><b>Figure {number}.</b> {escape(caption)}</figcaption></figure>"
    )


def table(head: Sequence[str], rows: Sequence[Sequence[object]], words: Sequence[int] = (), total: bool = False) -> str:
    """
    :param words: columns of text, set to the left; the first is always.
    :param total: the last row sums up.
    """

    def cell(tag: str, k: int, value: object) -> str:
        text = "-" if value is None else f"{value:.2f}" if isinstance(value, float) else escape(str(value))
        return f'<{tag} class="words">{text}</{tag}>' if k in words else f"<{tag}>{text}</{tag}>"

    lines = []
    for n, row in enumerate(rows):
        last = ' class="sum"' if total and n == len(rows) - 1 else ""
        lines.append(f"<tr{last}>" + "".join(cell("td", k, value) for k, value in enumerate(row)) + "</tr>")
    top = "".join(cell("th", k, value) for k, value in enumerate(head))
    return f"<table><thead><tr>{top}</tr></thead><tbody>{''.join(lines)}</tbody></table>"


def shares(parts: Sequence[tuple[str, float]]) -> str:
    """One bar for parts of a whole, and its key."""
    whole = sum(value for _, value in parts) or 1.0
    shown = [(name, 100 * value / whole, FILLS[k % len(FILLS)]) for k, (name, value) in enumerate(parts)]
    bar = "".join(f'<i style="width:{share:.2f}%;background:{fill}"></i>' for _, share, fill in shown)
    key = "".join(f'<span><i style="background:{f}"></i>{escape(n)} {s:.0f} %</span>' for n, s, f in shown)
    return f'<div class="share">{bar}</div><div class="key">{key}</div>'
