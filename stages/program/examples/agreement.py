"""How well two judges of the same candidates agree, as a program for `kind = "program"` that gathers.

Reads two inputs of `rollouts`, the first and the second of `options.judges`; makes one row for each object, for the seen
and the unseen objects, and for all: rates of all candidates, agreement, Cohen's kappa and McNemar's test.
"""

import json
import math
import sys

import pyarrow as pa
import pyarrow.parquet as pq

HELD = "held"


def kappa(n, one, other, differ):
    """J. Cohen, "A coefficient of agreement for nominal scales", 1960; 1 where every verdict of both is the same one."""
    a, b = one / n, other / n
    by_chance = a * b + (1 - a) * (1 - b)
    return 1.0 if by_chance == 1.0 else 1.0 - (differ / n) / (1.0 - by_chance)


def mcnemar(only_one, only_other):
    """Chance of a split at least as uneven if either judge is as likely to be the lenient one (exact, two-sided)."""
    n, least = only_one + only_other, min(only_one, only_other)
    return min(1.0, sum(math.comb(n, k) for k in range(least + 1)) * 2 / 2**n)


def summary(kind, name, pairs):
    """The row of some candidates, each with both verdicts."""
    n = len(pairs)
    one = sum(a == HELD for a, _ in pairs)
    other = sum(b == HELD for _, b in pairs)
    both = sum(a == b == HELD for a, b in pairs)
    lost = [b for a, b in pairs if a == HELD and b != HELD]
    usual = ("dropped", "slipped", "not_grasped", "too_deep")
    return {
        "of": kind, "name": name, "candidates_n": n, "first_n": one, "second_n": other, "both_n": both,
        "only_first_n": one - both, "only_second_n": other - both, "differ_n": one + other - 2 * both,
        "first_rate": one / n, "second_rate": other / n, "agreement": 1 - (one + other - 2 * both) / n,
        "kappa": kappa(n, one, other, one + other - 2 * both), "mcnemar_p": mcnemar(one - both, other - both),
        "accepted_hold": both / one if one else 0.0,
        **{f"lost_{reason}_n": lost.count(reason) for reason in usual},
        "lost_other_n": sum(reason not in usual for reason in lost),
    }


def verdicts(parts):
    """Verdicts by object and candidate, with the object's split."""
    found = {}
    for part in parts:
        for row in pq.read_table(part["files"]["part.parquet"]).to_pylist():
            found[part["partition"], row["candidate_id"]] = (row["reason"], row["object_split"])
    return found


def main():
    with open("job.json") as file:
        job = json.load(file)
    first, second = (verdicts(job["inputs"][name]) for name in job["options"]["judges"])
    if first.keys() != second.keys():
        sys.exit(f"the judges have judged different candidates: {sorted(first.keys() ^ second.keys())[:3]} …")
    if not first:
        sys.exit("there are no candidates")
    by_object, by_split = {}, {}
    for key, (verdict, split) in first.items():
        pair = (verdict, second[key][0])
        by_object.setdefault(key[0], []).append(pair)
        if split:
            by_split.setdefault(split, []).append(pair)
    rows = [summary("object", name, pairs) for name, pairs in sorted(by_object.items())]
    # Those to blame come first: where the two differ most often.
    rows.sort(key=lambda row: (-row["differ_n"], row["name"]))
    rows += [summary("split", name, pairs) for name, pairs in sorted(by_split.items())]
    rows.append(summary("all", "all", [pair for pairs in by_object.values() for pair in pairs]))
    columns = pq.read_schema(job["output"]["template"])
    pq.write_table(pa.Table.from_pylist(rows, schema=columns), job["output"]["table"])


if __name__ == "__main__":
    main()
