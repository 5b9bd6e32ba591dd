"""The site: every page of docs/ as HTML with one menu, and two pages that the program itself tells: commands and options.

    python docs/make_site.py [FOLDER]        default: site/

Nothing is fetched, by the build or by the pages. Anything that would be wrong on the site is an error: a page that is not in the menu, a link or a
picture that leads nowhere, a heading that a link names and that is not there.
"""

from __future__ import annotations

import argparse
import html
import re
import shutil
import sys
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

from markdown_it import MarkdownIt

from scan2fea import __version__
from scan2fea.cli.parser import parser
from scan2fea.pipeline.config import to_toml

DOCS = Path(__file__).parent
ROOT = DOCS.parent
# chapter -> pages in order; a page is a file of docs/, or made here
MENU = {
    "Begin": ("index", "start", "gallery", "report", "sensors", "limits"),
    "Reference": ("commands", "options", "changelog"),
    "Theory": (
        "theory", "acquisition", "fusion", "registration", "filtering", "segmentation", "kinds", "estimation", "holes", "reconstruction", "ranges",
        "meshing", "cad", "fea", "simulation", "thesis",
    ),
    "The code": ("design", "contributing"),
}  # fmt: skip
OUTSIDE = {"changelog": ROOT / "CHANGELOG.md", "contributing": ROOT / "CONTRIBUTING.md"}
STYLE = """
:root{color-scheme:light dark;--ink:#1b1f23;--paper:#fff;--line:#d5d9dd;--soft:#f5f6f7;--link:#0b5cad}
@media(prefers-color-scheme:dark){:root{--ink:#e4e6e8;--paper:#16191c;--line:#3a4046;--soft:#20252a;--link:#7db8f5}}
*{box-sizing:border-box} body{margin:0;font:16px/1.55 system-ui,sans-serif;color:var(--ink);background:var(--paper);display:flex;min-height:100vh}
a{color:var(--link)} nav{width:15rem;flex:none;padding:1rem 1.2rem;border-right:1px solid var(--line);background:var(--soft)}
nav b{display:block;margin:1rem 0 .2rem} nav a{display:block;padding:.1rem 0;text-decoration:none}
nav a[aria-current]{font-weight:600;text-decoration:underline}
main{padding:1rem 2rem 4rem;min-width:0;max-width:62rem;flex:1} img{max-width:100%;height:auto;border:1px solid var(--line);background:#fff}
pre,code{font:.86em/1.45 ui-monospace,monospace;background:var(--soft)} code{padding:0 .2em}
pre{padding:.7rem .9rem;overflow-x:auto;border:1px solid var(--line)}
pre code{padding:0;font-size:1em} .wide{overflow-x:auto} table{border-collapse:collapse;margin:.8rem 0;font-size:.92em}
th,td{border:1px solid var(--line);padding:.3rem .55rem;text-align:left;vertical-align:top} th{background:var(--soft)}
h1,h2,h3{line-height:1.25} h2{margin-top:2rem;border-bottom:1px solid var(--line)}
@media(max-width:800px){body{display:block} nav{width:auto;border-right:0;border-bottom:1px solid var(--line);padding:.5rem 1rem}
nav a{display:inline-block;margin-right:.8rem} nav b{margin:.4rem 0 0} main{padding:1rem}}
@media print{nav{display:none} main{max-width:none}}
"""


class SiteError(Exception):
    """Something on the site would be wrong."""


def commands_page() -> str:
    """Markdown of every command with its arguments, from the parser itself."""
    top = parser()
    actions = next(action for action in top._actions if isinstance(action, argparse._SubParsersAction))
    summary = {choice.dest: str(choice.help) for choice in actions._choices_actions}
    lines = ["# Commands", "", "From the command line's own parser; `scan2fea COMMAND --help` says the same.", ""]
    lines += ["| command | what it does |", "|---|---|", *(f"| [`{name}`](#{name}) | {_cell(summary[name])} |" for name in actions.choices), ""]
    for name, command in actions.choices.items():
        lines += [f"## {name}", "", f"{summary[name][0].upper()}{summary[name][1:]}.", "", "| argument | what it is |", "|---|---|"]
        lines += [f"| `{_form(action)}` | {_cell(action.help or '')} |" for action in command._actions if action.help != argparse.SUPPRESS]
        lines.append("")
    return "\n".join(lines)


def _form(action: argparse.Action) -> str:
    """How an argument is written."""
    given = action.metavar if isinstance(action.metavar, str) else " ".join(action.metavar or ()) or action.dest.upper()
    several = {"+": " ...", "*": " ..."}.get(str(action.nargs), "")
    if not action.option_strings:
        return f"{given}{several}"
    return ", ".join(action.option_strings) + ("" if action.nargs == 0 else f" {given}{several}")


def _cell(text: str) -> str:
    return html.escape(text, quote=False).replace("|", "\\|")


def options_page() -> str:
    """Markdown of every option with its default and explanation, as `scan2fea config` prints it."""
    head = "Every option with its default and what it does, as `scan2fea config` prints it. None needs to be set; `-c FILE.toml` and `--set` do."
    return f"# Options\n\n{head}\n\n```toml\n{to_toml()}```\n"


def sources() -> dict[str, str]:
    """Page -> its Markdown. Raises SiteError where a file of docs/ is not in the menu, or a page of the menu has no file."""
    made = {"commands": commands_page(), "options": options_page()}
    files = {path.stem: path for path in DOCS.glob("*.md")} | OUTSIDE
    wanted = [page for pages in MENU.values() for page in pages]
    lost, absent = sorted(set(files) - set(wanted)), sorted(set(wanted) - set(files) - set(made))
    if lost or absent:
        raise SiteError(f"not in the menu of docs/make_site.py: {', '.join(lost) or 'none'}; in it without a file: {', '.join(absent) or 'none'}")
    return {page: made[page] if page in made else files[page].read_text(encoding="utf-8") for page in wanted}


def build(folder: Path) -> list[str]:
    """Write the site; returns its pages. Raises SiteError."""
    texts = sources()
    folder.mkdir(parents=True, exist_ok=True)
    titles = {page: _title(page, text) for page, text in texts.items()}
    bodies = {page: _body(page, text) for page, text in texts.items()}
    faults = [fault for page, body in bodies.items() for fault in _faults(page, body, bodies)]
    if faults:
        raise SiteError("; ".join(faults))
    for page, body in bodies.items():
        (folder / f"{page}.html").write_text(_page(page, titles, body), encoding="utf-8", newline="\n")
    shutil.copytree(DOCS / "img", folder / "img", dirs_exist_ok=True)
    return list(texts)


def _title(page: str, text: str) -> str:
    found = re.search(r"^# (.+)$", text, re.M)
    if found is None:
        raise SiteError(f"{page}: has no heading of the first level")
    return found[1].replace("`", "").split(":")[0]


def _body(page: str, text: str) -> str:
    """HTML of a page: headings get names, tables may scroll, links to other pages lead to their HTML."""
    md = MarkdownIt("commonmark", {"html": False}).enable("table")
    tokens, names = md.parse(text), set[str]()
    for token, after in pairwise(tokens):
        if token.type == "heading_open":
            name = re.sub(r"[^\w]+", "-", after.content.lower()).strip("-")
            while name in names:
                name += "-"
            names.add(name)
            token.attrSet("id", name)
    made = md.renderer.render(tokens, md.options, {})
    made = re.sub(r'href="(?:\.\./|docs/)?(\w+)\.md(#[^"]*)?"', lambda m: f'href="{m[1].lower()}.html{m[2] or ""}"', made)
    return made.replace("<table>", '<div class="wide"><table>').replace("</table>", "</table></div>")


def _faults(page: str, body: str, bodies: dict[str, str]) -> Iterator[str]:
    """What leads nowhere."""
    for target in re.findall(r'(?:href|src)="([^"]+)"', body):
        if re.match(r"https?:|mailto:", target):
            continue
        path, _, heading = target.partition("#")
        other = path.removesuffix(".html") or page
        if path.endswith(".html") or not path:
            if other not in bodies:
                yield f"{page}: links to {target}, which is no page"
            elif heading and f'id="{heading}"' not in bodies[other]:
                yield f"{page}: links to {target}, which is no heading there"
        elif not (DOCS / path).is_file():
            yield f"{page}: {target} is not there"


def _page(page: str, titles: dict[str, str], body: str) -> str:
    menu = []
    for chapter, pages in MENU.items():
        menu.append(f"<b>{chapter}</b>")
        menu += [f'<a href="{p}.html"{" aria-current=page" if p == page else ""}>{html.escape(titles[p])}</a>' for p in pages]
    title = f"<title>{html.escape(titles[page])}: scan2fea</title>"
    head = f'<meta charset="utf-8"><meta name="viewport" content="width=device-width, initial-scale=1">{title}'
    nav = f"<nav><strong>scan2fea {__version__}</strong>{''.join(menu)}</nav>"
    return f'<!DOCTYPE html>\n<html lang="en"><head>{head}<style>{STYLE}</style></head>\n<body>{nav}<main>\n{body}</main></body></html>\n'


def main() -> int:
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "site"
    try:
        pages = build(folder)
    except SiteError as error:
        print(f"make_site: {error}", file=sys.stderr)
        return 1
    print(f"{len(pages)} pages in {folder}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
