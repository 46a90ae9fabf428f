"""``report``: metrics, tables, figures and one page to hand on, from the recording of a run alone."""

import argparse
import csv
import io
import sys
from pathlib import Path

import msgspec

from groundstation import compare, comparison
from groundstation.compare import groups, table
from groundstation.figures import draw
from groundstation.files import write_whole
from groundstation.metrics import Metrics, failures
from groundstation.page import page
from groundstation.recording import RecordingError
from groundstation.runfolder import Run, read, write_manifest, write_metrics
from groundstation.scenes import Film

FIGURES = "figures"
PAGE = "report.html"
TABLE = "metrics.csv"


def rows_of(metrics: Metrics) -> list[tuple[str, object]]:
    """Every number of the metrics as (dotted name, value)."""

    def walk(prefix: str, value: object) -> list[tuple[str, object]]:
        if isinstance(value, dict):
            return [row for key, entry in value.items() for row in walk(f"{prefix}.{key}" if prefix else key, entry)]
        return [(prefix, " | ".join(map(str, value)) if isinstance(value, list | tuple) else value)]

    return walk("", msgspec.to_builtins(metrics))


def csv_of(metrics: Metrics) -> bytes:
    """``metrics.csv``: one number a line."""
    text = io.StringIO(newline="")
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(("metric", "value"))
    writer.writerows(rows_of(metrics))
    return text.getvalue().encode()


def write_report(run: Run) -> Path:
    """Metrics, table, figures, page and manifest of a judged run; the page's path.

    :raises ValueError: no mission was started, so there is nothing to report.
    """
    mission = run.history.mission()
    if run.metrics is None or mission is None:
        raise ValueError(f"{run.recording.path}: no mission was started")
    write_metrics(run)
    write_whole(run.folder / TABLE, csv_of(run.metrics))
    draw(Film(run.history, mission), run.folder / FIGURES)
    write_whole(run.folder / PAGE, page(run, run.metrics, run.folder / FIGURES))
    write_manifest(run)
    return run.folder / PAGE


def finish(path: Path) -> list[str]:
    """Judge and report a run that has ended; why it is not a success, empty for a success.

    :raises RecordingError: there is no readable recording.
    """
    run = read(path)
    if run.metrics is not None:
        write_report(run)
    return failures(run.metrics)


def configure(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "runs", type=Path, nargs="+", metavar="RUN", help="run folders, or recordings; several are compared"
    )
    parser.add_argument("--page", type=Path, metavar="FILE", help="write the comparison as a page of its own (HTML)")
    parser.add_argument("--csv", type=Path, metavar="FILE", help="write the numbers of all runs, one a line")


def run(args: argparse.Namespace) -> int:
    """Exit code 0: all reported; 1: a run without a mission; 2: no recording. Missions may have failed."""
    code = 0
    reported: list[tuple[str, Metrics]] = []
    for path in args.runs:
        try:
            found = read(path)
            print(write_report(found))
        except RecordingError as error:
            print(error, file=sys.stderr)
            code = 2
            continue
        except ValueError as error:
            print(error, file=sys.stderr)
            code = code or 1
            continue
        assert found.metrics is not None
        reported.append((str(path), found.metrics))
    if len(reported) > 1:
        rows = table(groups(metrics for _, metrics in reported))
        widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
        for row in rows:
            print("  ".join(text.ljust(width) for text, width in zip(row, widths, strict=True)).rstrip())
    if args.page and reported:
        write_whole(args.page, comparison.page(reported))
        print(args.page)
    if args.csv:
        write_whole(args.csv, compare.csv_of(reported))
    return code
