"""A study's report: one page for browsers with tables, ends of episodes, traces and films, and the same in Markdown."""

import base64
import html
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from iwalker_jax.errors import InputError
from iwalker_jax.evaluation.episodes.study import Study
from iwalker_jax.evaluation.episodes.tables import episode_table, failures
from iwalker_jax.evaluation.tables import Table, markdown_table
from iwalker_jax.runtime import write_text

_STYLE = """
:root { color-scheme: light; --ink: #22242a; --soft: #6b6f78; --line: #e2e1dc; --back: #fbfbf9; --accent: #1f6fb2; }
* { box-sizing: border-box; }
body { margin: 0; background: var(--back); color: var(--ink); font: 15px/1.55 system-ui, sans-serif; }
main { max-width: 1280px; margin: 0 auto; padding: 36px 24px 72px; }
h1 { font-size: 27px; margin: 0 0 4px; } h2 { font-size: 19px; margin: 44px 0 12px; }
p.soft, li.soft, figcaption, .legend { color: var(--soft); font-size: 13px; }
.scroll { overflow-x: auto; border: 1px solid var(--line); border-radius: 8px; background: #fff; }
table { border-collapse: collapse; width: 100%; font-size: 13px; font-variant-numeric: tabular-nums; }
th, td { padding: 7px 9px; text-align: right; white-space: nowrap; border-bottom: 1px solid var(--line); }
tr:last-child td { border-bottom: 0; }
th { color: var(--soft); font-weight: 600; background: #f5f4f0; white-space: normal; vertical-align: bottom; }
td.label, th.label { text-align: left; } td small { display: block; color: var(--soft); font-size: 11px; }
dl { display: grid; grid-template-columns: max-content 1fr; gap: 3px 18px; margin: 0; }
dt { color: var(--soft); } dd { margin: 0; }
.bar { display: flex; height: 16px; min-width: 320px; border-radius: 4px; overflow: hidden; background: var(--line); }
.bar span { display: block; height: 100%; }
.key { display: inline-block; width: 11px; height: 11px; border-radius: 3px; margin: 0 6px 0 14px; }
figure { margin: 0 0 26px; }
img, video { display: block; width: 100%; border: 1px solid var(--line); border-radius: 8px; }
.films { display: grid; grid-template-columns: repeat(auto-fit, minmax(440px, 1fr)); gap: 18px; }
"""


@dataclass(frozen=True)
class Report:
    """What a report shows.

    Attributes:
        title: of the page.
        settings: by name, in words.
        machine: that it ran on.
        study: what came of it.
        frames: table of single frames, if they were evaluated too.
    """

    title: str
    settings: Mapping[str, str]
    machine: str
    study: Study
    frames: Table | None = None


def write_report(folder: Path, report: Report) -> Path:
    """Write report.html, with pictures inside and films beside it, and report.md; returns the page.

    Args:
        folder: where they go; films must lie in it.
        report: what to show.

    Raises:
        InputError: files that cannot be written or pictures that cannot be read.
    """
    page = folder / "report.html"
    try:
        write_text(page, _page(folder, report))
        write_text(folder / "report.md", _markdown(folder, report))
    except OSError as error:
        raise InputError(f"The report {page} cannot be written ({error.strerror}: {error.filename}).") from error
    return page


def _page(folder: Path, report: Report) -> str:
    study = report.study
    parts = [f"<h1>{_text(report.title)}</h1>", f'<p class="soft">{_text(report.machine)}</p>']
    parts.append("<h2>Settings</h2><dl>")
    parts += [f"<dt>{_text(name)}</dt><dd>{_text(value)}</dd>" for name, value in report.settings.items()]
    parts.append("</dl>")
    if study.groups:
        table = episode_table(study.groups)
        parts.append("<h2>Episodes</h2>" + _table(table.cells(), labels=2))
        parts.append('<p class="soft">Rates with Wilson\'s 95 % interval, figures with their standard deviation.</p>')
        parts.append(_legend(table.legend()))
        parts.append("<h2>How the episodes ended</h2>" + _endings(study))
    if study.films:
        parts.append('<h2>Films</h2><div class="films">')
        parts += [_film(title, file.relative_to(folder).as_posix()) for title, file in study.films]
        parts.append("</div>")
    if study.sheets:
        parts.append("<h2>From above</h2>")
        parts += [_picture(title, file) for title, file in study.sheets]
    if report.frames is not None:
        parts.append("<h2>Single frames</h2>" + _table(report.frames.cells(), len(report.frames.labels)))
        parts.append(_legend(report.frames.legend()))
    if study.seconds:
        parts.append("<h2>Where the time went</h2>" + _table(_spent(study.seconds), labels=1))
    body = "\n".join(parts)
    return (
        f'<!doctype html>\n<html lang="en"><head><meta charset="utf-8"><title>{_text(report.title)}</title>\n'
        f'<meta name="viewport" content="width=device-width, initial-scale=1">\n<style>{_STYLE}</style></head>\n'
        f"<body><main>\n{body}\n</main></body></html>\n"
    )


def _markdown(folder: Path, report: Report) -> str:
    study = report.study
    parts = [f"# {report.title}", report.machine]
    parts.append("\n".join(f"- {name}: {value}" for name, value in report.settings.items()))
    if study.groups:
        table = episode_table(study.groups)
        parts += ["## Episodes", table.markdown(), table.legend()]
        parts += ["## How the episodes ended", markdown_table(_ending_cells(study))]
    for title, files in (("Films", study.films), ("From above", study.sheets)):
        links = [f"- [{name}]({file.relative_to(folder).as_posix()})" for name, file in files]
        parts += [f"## {title}", "\n".join(links)] if links else []
    if report.frames is not None:
        parts += ["## Single frames", report.frames.markdown(), report.frames.legend()]
    if study.seconds:
        parts += ["## Where the time went", markdown_table(_spent(study.seconds))]
    return "\n\n".join(parts) + "\n"


def _text(words: str) -> str:
    return html.escape(words, quote=True)


def _table(cells: Sequence[Sequence[str]], labels: int) -> str:
    """An HTML table of cells, header first; the first columns are labels, spreads go under their means."""
    header, *body = cells
    lines = [_row("th", header, labels), *(_row("td", line, labels) for line in body)]
    return f'<div class="scroll"><table>{"".join(lines)}</table></div>'


def _row(tag: str, line: Sequence[str], labels: int) -> str:
    shown = []
    for i, value in enumerate(line):
        text = _text(value)
        for mark, sign in ((" [", "["), (" +- ", "± ")):
            if tag == "td" and mark in value:
                mean, spread = value.split(mark, 1)
                text = f"{_text(mean)}<small>{sign}{_text(spread)}</small>"
        shown.append(f"<{tag}{' class=label' if i < labels else ''}>{text}</{tag}>")
    return f"<tr>{''.join(shown)}</tr>"


def _legend(lines: str) -> str:
    items = "".join(f"<li>{_text(line.removeprefix('- '))}</li>" for line in lines.splitlines())
    return f'<details class="legend"><summary>What the columns mean</summary><ul>{items}</ul></details>'


def _ending_cells(study: Study) -> list[list[str]]:
    counts = failures(study.groups)
    kinds = list(next(iter(counts.values())))
    lines = [["policy", "scenes", *(kind.sentence for kind in kinds)]]
    return lines + [[*key, *(str(count[kind]) for kind in kinds)] for key, count in counts.items()]


def _endings(study: Study) -> str:
    counts = failures(study.groups)
    kinds = list(next(iter(counts.values())))
    keys = "".join(f'<span class="key" style="background:{k.colour}"></span>{_text(k.sentence)}' for k in kinds)
    rows = ["<tr><th class=label>policy</th><th class=label>scenes</th><th class=label></th>"]
    rows += [f"<th>{_text(kind.word)}</th>" for kind in kinds] + ["</tr>"]
    for (policy, scenes), count in counts.items():
        total = sum(count.values())
        bar = "".join(
            f'<span style="width:{100 * n / total:.2f}%;background:{kind.colour}"></span>' for kind, n in count.items()
        )
        rows.append(f"<tr><td class=label>{_text(policy)}</td><td class=label>{_text(scenes)}</td>")
        rows.append(f'<td class=label><div class="bar">{bar}</div></td>')
        rows += [f"<td>{n}</td>" for n in count.values()] + ["</tr>"]
    return f'<p class="soft">{keys}</p><div class="scroll"><table>{"".join(rows)}</table></div>'


def _film(title: str, address: str) -> str:
    video = f'<video controls muted loop preload="metadata" src="{_text(address)}"></video>'
    return f'<figure>{video}<figcaption><a href="{_text(address)}">{_text(title)}</a></figcaption></figure>'


def _picture(title: str, file: Path) -> str:
    data = base64.b64encode(file.read_bytes()).decode()
    image = f'<img alt="{_text(title)}" src="data:image/png;base64,{data}">'
    return f"<figure>{image}<figcaption>{_text(title)}</figcaption></figure>"


def _spent(seconds: Mapping[str, float]) -> list[list[str]]:
    total = sum(seconds.values())
    lines = [[purpose, f"{spent:.0f}", f"{100 * spent / max(total, 1e-9):.0f}"] for purpose, spent in seconds.items()]
    return [["", "seconds", "%"], *lines, ["together", f"{total:.0f}", "100"]]
