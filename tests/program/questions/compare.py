"""Asks `pipeline query` and DuckDB the same random statements: `compare.py PIPELINE LAKE COUNT SEED`.

Prints what differs, and as its last line a JSON object with what was asked and answered.
"""

import concurrent.futures
import datetime
import json
import math
import os
import subprocess
import sys
import tempfile
from decimal import Decimal
from pathlib import Path

import duckdb
import pyarrow as pa
import pyarrow.parquet as pq

from statements import BOOL, DATE, FLOAT, INT, TEXT, Tables, statements

ARROW = {INT: pa.int64(), FLOAT: pa.float64(), TEXT: pa.string(), BOOL: pa.bool_(), DATE: pa.date32(), "time": pa.timestamp("us")}
# Words of the engine, which no message has.
INSIDE = ["Expr", "Plan", "Physical", "Logical", "DataFusion", "Arrow", "Int64", "Utf8", "Float64", "Date32", "Timestamp(", "Some(", "::", "{ ", "schema", "UDF", "panicked"]


def write(tables, folder):
    for table, columns in tables.columns.items():
        cells = zip(*tables.rows[table]) if tables.rows[table] else [[] for _ in columns]
        arrays = [pa.array(list(values), ARROW[kind]) for values, (_, kind) in zip(cells, columns)]
        pq.write_table(pa.table(arrays, names=[name for name, _ in columns]), folder / f"{table}.parquet")


def value(cell):
    """A value of either side in one form."""
    if isinstance(cell, Decimal):
        return float(cell)
    if isinstance(cell, datetime.datetime):
        text = cell.isoformat()
        return text.removesuffix("T00:00:00")
    if isinstance(cell, datetime.date):
        return cell.isoformat()
    if isinstance(cell, str):
        numbers = {"NaN": math.nan, "Infinity": math.inf, "-Infinity": -math.inf}
        if cell in numbers:
            return numbers[cell]
        return cell.removesuffix("T00:00:00") if len(cell) == 19 and cell[10] == "T" else cell
    return cell


def key(row):
    def of(cell):
        if cell is None:
            return (0, "")
        if isinstance(cell, bool):
            return (1, str(cell))
        if isinstance(cell, (int, float)):
            return (2, f"{cell + 0.0:.6e}")
        return (3, str(cell))

    return [of(cell) for cell in row]


def equal(a, b):
    if a is None or b is None or isinstance(a, bool) != isinstance(b, bool):
        return a is b
    if isinstance(a, (int, float)) and isinstance(b, (int, float)):
        if math.isnan(a) or math.isnan(b):
            return math.isnan(a) and math.isnan(b)
        return a == b or math.isclose(a, b, rel_tol=1e-9, abs_tol=1e-9)
    return type(a) is type(b) and a == b


def same(ours, theirs, is_ordered):
    if len(ours) != len(theirs):
        return False
    if not is_ordered:
        ours, theirs = sorted(ours, key=key), sorted(theirs, key=key)
    return all(len(a) == len(b) and all(map(equal, a, b)) for a, b in zip(ours, theirs))


def main(program, lake, count, seed):
    # With several threads some of its windows vary from one answer to the next.
    duckdb.sql("set threads = 1")
    asked, answered, refused, wrong, rude, failed, has = 0, 0, {}, [], [], [], {}
    folder = None

    def ask(statement, folder):
        command = [program, "query", statement, "--lake", lake, "--allow-files", str(folder), "--format", "json"]
        return subprocess.run(command, capture_output=True, text=True)

    made = statements(seed, lambda table: folder / f"{table}.parquet")
    kept = tempfile.TemporaryDirectory()
    with concurrent.futures.ThreadPoolExecutor(os.cpu_count()) as pool:
        batch = []
        n_folders = 0

        while asked < count:
            one = next(made)
            if isinstance(one, Tables):
                n_folders += 1
                folder = Path(kept.name) / str(n_folders)
                folder.mkdir()
                write(one, folder)
                continue
            statement, is_ordered, parts = one
            batch.append((statement, is_ordered, parts, folder))
            if len(batch) < 16 and asked + len(batch) < count:
                continue
            runs = [pool.submit(ask, statement, folder) for statement, _, _, folder in batch]
            for (statement, is_ordered, parts, _), run in zip(batch, runs):
                said = run.result()
                try:
                    theirs = [[value(cell) for cell in row] for row in duckdb.sql(statement).fetchall()]
                except Exception as err:
                    failed.append((statement, str(err).splitlines()[0]))
                    continue
                asked += 1
                for part in parts:
                    has[part] = has.get(part, 0) + 1
                if said.returncode != 0:
                    message = said.stderr.strip()
                    refused[message] = refused.get(message, 0) + 1
                    if said.returncode != 2 or "\nhint: " not in message or any(word in message for word in INSIDE):
                        rude.append((statement, message))
                    continue
                answered += 1
                ours = [[value(cell) for cell in json.loads(line).values()] for line in said.stdout.splitlines()]
                if not same(ours, theirs, is_ordered):
                    wrong.append((statement, ours[:8], theirs[:8]))
            batch.clear()
    for statement, ours, theirs in wrong:
        print(f"differs: {statement}\n  ours   {ours}\n  theirs {theirs}")
    for statement, message in rude:
        print(f"no good message: {statement}\n  {message}")
    if os.environ.get("SHOW_REFUSED"):
        for message, n in sorted(refused.items(), key=lambda entry: -entry[1]):
            print(n, message)
        for statement, message in failed[:20]:
            print("DuckDB:", message, "|", statement)
    print(json.dumps({"asked": asked, "answered": answered, "wrong": len(wrong), "rude": len(rude), "unasked": len(failed), **has}))


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2], int(sys.argv[3]), int(sys.argv[4]))
