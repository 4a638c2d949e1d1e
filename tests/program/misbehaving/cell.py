"""A robot cell that misbehaves in one named way, to test a dispatcher: the example's cell in Python, but for that.

In its journal's folder it counts what no answer can hide. `transmissions` has a line for each goal message that
arrives, with what the cell had said last of `simulated` (`true`, `false`, or `none`) and the goal's id. `executed`
has a line for each motion that it really executes, with the goal's id and how it really ended.
"""
import json, os, pathlib, sys, threading, types

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[3] / "crates/cell/examples/python"))
import numpy as np, zenoh
from cell import Cell, arguments
from wire import Key, answer_text, hex_digest, line, split

# What may come of a dispatcher's run with two goals, without permission to move something real.
HARMLESS = "harmless"  # each goal is sent and executed once, and its outcome is the cell's
NOTHING = "nothing sent"  # no goal is sent; the run ends with an error that names the reason
FIRST = "first goal only"  # the first goal as in a good run; then nothing is sent any more
REFUSED = "refused"  # what was sent is refused with the code and the reason; nothing is executed
UNKNOWN = "unknown"  # the first goal's outcome is unknown, and nothing is sent any more: exit with 1
# As `UNKNOWN`, but the cell has a good report, which the next run gets before it sends anything.
RECOVERED = "unknown, then recovered"
EITHER = "no goal, or the first only"  # as `NOTHING` if it asks twice before its first goal, else as `FIRST`
TWICE = "harmless, but executed twice"  # as `HARMLESS`, but the cell executes the first goal twice
STALE = "first goal, then unknown"  # the first goal as in a good run; the second's outcome is unknown

KINDS = {
    # What the cell says that it is.
    "real_from_second_goal": ("see before the second goal that the cell became real", FIRST),
    "real_from_second_capabilities": ("send nothing from then on", EITHER),
    "real_on_retransmission": ("ask again before it repeats the unanswered goal, and not repeat it", UNKNOWN),
    "simulated_missing": ("not take a missing `simulated` for true", NOTHING),
    "simulated_as_text": ("not take the string `true` for true", NOTHING),
    "stopped_missing": ("not take a missing `stopped` for false", NOTHING),
    "stopped_from_start": ("say that somebody must resume the cell", NOTHING),
    "stopped_from_second_goal": ("say before the second goal that somebody must resume the cell", FIRST),
    "palm_speed_lowered": ("see that the limits changed since the first answer", EITHER),
    "palm_speed_lowered_after_goal": ("see that the limits changed since the first answer", FIRST),
    "palm_too_slow": ("compare its goals with the cell's limits", NOTHING),
    "palm_missing": ("send a flying palm's goal to no cell without `palm`", NOTHING),
    "workspace_inverted": ("see that the least corner is above the greatest", NOTHING),
    "other_robot": ("compare the robot's digest with its own", NOTHING),
    "other_robot_from_second_goal": ("see that the robot changed since the first answer", FIRST),
    "other_joints": ("compare the controllers' joints with its own", NOTHING),
    "tiny_max_goal_bytes": ("not send a goal that is longer", NOTHING),
    "other_cell_name": ("not trust a cell of another name", NOTHING),
    "other_journal_named": ("not trust capabilities that name another journal than the one that signs", NOTHING),
    "clock_5_s_ahead": ("compare the clocks", NOTHING),
    "clock_5_s_behind": ("compare the clocks", NOTHING),
    "protocol_4": ("name the version, although version 4 signs otherwise, and say: update the cell", NOTHING),
    "protocol_6": ("name the version and say: update the dispatcher", NOTHING),
    "capabilities_unreadable": ("say that the answer cannot be read", NOTHING),
    "capabilities_of_2_mb": ("read no answer beyond 1 MiB", NOTHING),
    "hostile_gap": ("show it without control characters, in at most a line", HARMLESS),
    "unknown_field": ("ignore a field that is not on the page", HARMLESS),
    "executes_another_forever": ("be refused with `busy`, or wait before it sends", REFUSED),
    # Who it says that it is.
    "unsigned_answers": ("trust no answer without a valid signature", NOTHING),
    "signs_without_parameters": ("verify the parameters that it sent", NOTHING),
    "signs_another_key_queried": ("verify the key that it queried", NOTHING),
    "upper_case_journal": ("not trust names in upper case: digits are lower-case", NOTHING),
    "other_journal_after_goal": ("send nothing to another journal than the first goal's", FIRST),
    "other_journal_before_report": ("not believe another journal's report", UNKNOWN),
    "second_answerer": ("name both that answer to a result, and believe none", UNKNOWN),
    # What it does with goals.
    "loses_goals_keeps_key": ("repeat the unanswered goal: that it moves again only the cell could prevent", TWICE),
    "loses_first_transmission": ("repeat the same goal, after another look", HARMLESS),
    "executes_without_answer": ("repeat the same goal, which is then known and moves nothing", HARMLESS),
    "executes_without_any_answer": ("give up, and query the result in the next run", RECOVERED),
    "accepts_then_denies": ("not repeat an accepted goal when told `never_taken`, in no run", UNKNOWN),
    "executes_then_denies": ("not repeat an accepted goal when told `never_taken`, in no run", UNKNOWN),
    "reports_then_forgets": ("not repeat an accepted goal when told `never_taken` in the next run", HARMLESS),
    "accepts_never_executes": ("give up after its longest wait", UNKNOWN),
    "accepted_of_other_bytes": ("not count an answer to other bytes than it sent", UNKNOWN),
    "accepted_by_another_key": ("not count it, and query the result in the next run", RECOVERED),
    "two_different_answers": ("not choose one, and query the result in the next run", RECOVERED),
    "two_equal_answers": ("count them once", HARMLESS),
    "answer_not_on_page": ("not guess what `maybe` means, and query the result in the next run", RECOVERED),
    "answer_unreadable": ("not guess, and query the result in the next run", RECOVERED),
    "answer_of_2_mb": ("read no answer beyond 1 MiB, and query the result in the next run", RECOVERED),
    "says_known_of_new": ("take the report; say that this answer moved nothing, as the cell claims", HARMLESS),
    "refuses_but_executes": ("believe the refusal: only the cell could keep what it signed", REFUSED),
    "refuses_estop": ("take an unlisted code for a refusal, and say it", REFUSED),
    "refuses_busy": ("say it; nothing moved", REFUSED),
    "refuses_storage": ("say it; nothing moved", REFUSED),
    "refuses_stopped": ("say it; nothing moved", REFUSED),
    "refuses_limits": ("say it; nothing moved", REFUSED),
    "refuses_object": ("say it; nothing moved", REFUSED),
    "hostile_refusal": ("show code and reason without control characters, in at most a line each", REFUSED),
    # What it reports.
    "no_samples": ("believe no success without samples", UNKNOWN),
    "frozen": ("see that nothing moved", UNKNOWN),
    "lift_minus_5": ("compare the rise with the samples", UNKNOWN),
    "lift_1e308": ("compare the rise with the samples, and show the number in a line", UNKNOWN),
    "lift_1e300": ("compare the rise with the samples, and show the number in a line", UNKNOWN),
    "lift_not_a_number": ("not read NaN as JSON", UNKNOWN),
    "times_back": ("see that times do not increase", UNKNOWN),
    "joints_order": ("compare the joints with the goal's, in their order", UNKNOWN),
    "narrow": ("see that the rows are not whole", UNKNOWN),
    "short": ("see that a success ends before its motion", UNKNOWN),
    "samples_not_numbers": ("refuse rows with NaN", UNKNOWN),
    "samples_n_wrong": ("see that not as many rows follow as the report says, or ignore it", UNKNOWN),
    "commands_of_another_goal": ("compare commanded positions with the goal's", UNKNOWN),
    "palm_elsewhere": ("compare the palm's places with the goal's", UNKNOWN),
    "object_elsewhere": ("compare the object's first place with the goal's", UNKNOWN),
    "object_rises_alone": ("see that the palm did not rise with the object", UNKNOWN),
    "report_of_another_goal": ("compare the report's goal with its own", UNKNOWN),
    "stale_report_renamed": ("see that the second report is of the first motion, if the motions differ", STALE),
    "report_unknown": ("send nothing more; the next run may go on", UNKNOWN),
    "report_unreadable": ("not guess; the outcome is unknown", UNKNOWN),
    "report_without_message": ("not guess; the outcome is unknown", UNKNOWN),
    "outcome_not_on_page": ("not guess what `exploded` means", UNKNOWN),
    "outcome_rejected": ("see that an accepted goal cannot end as `rejected`", UNKNOWN),
    "outcome_aborted": ("take it for what it says; samples up to there are good", HARMLESS),
    "outcome_stopped": ("take it for what it says; only a person has it sent again", HARMLESS),
    "report_of_70_mb": ("give up: neither the report nor its first line arrives", UNKNOWN),
    "report_of_70_mb_has_line": ("ask with `samples=none`, and say that no sample confirms the outcome", HARMLESS),
    "first_line_only": ("believe no success whose samples do not come", UNKNOWN),
    "never_answers_result": ("give up after its longest wait, `samples=none` included", UNKNOWN),
    "never_taken_once": ("not repeat an accepted goal when told `never_taken`; the next run has its report", RECOVERED),
    "hostile_message": ("show 100 kB with control characters and U+202E in at most a line", HARMLESS),
    "false_outcome_published": ("believe the report, not the publication", HARMLESS),
    "false_results": ("believe the report; a watcher names what contradicts itself in `results`", HARMLESS),
    "never_answers_cancel": ("on an interrupt, say that the robot may be moving", HARMLESS),
    "answers_cancel_while_moving": ("say on an interrupt what the cell says; it moves on", HARMLESS),
}
CONTRADICTIONS = ("no_samples", "frozen", "lift_minus_5", "lift_1e308", "times_back", "joints_order", "narrow", "short",
                  "second_answerer")
HOSTILE = "\u202enekorb\u202c \x1b[2J\x1b]0;title\x07\r\n\u200b\u2066" + "x" * 100_000
LONG = 70_000_000


class MisbehavingCell(Cell):
    def __init__(self, args):
        self.kind, self.told, self.held = args.misbehave, None, []
        args.contradict = self.kind if self.kind in CONTRADICTIONS else None
        super().__init__(args)
        self.other = Key(self.folder / "other")
        self.can_n = self.goals_n = self.asked_n = self.reported_n = 0
        self.is_real, self.first_samples, self.true_outcome = False, None, None

    def note(self, name, *words):
        with open(self.folder / name, "a") as file:
            file.write(" ".join(words) + "\n")
            file.flush()
            os.fsync(file.fileno())

    # What it says that it is, and who.

    def can(self):
        can, kind, again, later = super().can(), self.kind, self.can_n > 0, self.reported_n > 0
        self.can_n += 1
        real = {"real_from_second_goal": later, "real_from_second_capabilities": again}
        if self.is_real or real.get(kind):
            can["simulated"] = False
        slow = {**can["palm"], "speed_m_per_s": 1e-3}
        low, high = can["palm"]["workspace_m"]
        is_now, changed = {
            "simulated_as_text": (True, {"simulated": "true"}),
            "stopped_from_start": (True, {"stopped": True}),
            "stopped_from_second_goal": (later, {"stopped": True}),
            "palm_speed_lowered": (again, {"palm": slow}),
            "palm_speed_lowered_after_goal": (later, {"palm": slow}),
            "palm_too_slow": (True, {"palm": slow}),
            "workspace_inverted": (True, {"palm": {**can["palm"], "workspace_m": [high, low]}}),
            "other_robot": (True, {"robot": hex_digest(b"another robot")}),
            "other_robot_from_second_goal": (later, {"robot": hex_digest(b"another robot")}),
            "other_joints": (True, {"controllers": [can["controllers"][0], {
                **can["controllers"][1], "joints": ["another", *can["controllers"][1]["joints"][1:]]}]}),
            "tiny_max_goal_bytes": (True, {"max_goal_bytes": 1000}),
            "other_cell_name": (True, {"cell": "elsewhere"}),
            "other_journal_named": (True, {"journal": self.other.public}),
            "clock_5_s_ahead": (True, {"clock_unix_ms": can["clock_unix_ms"] + 5000}),
            "clock_5_s_behind": (True, {"clock_unix_ms": can["clock_unix_ms"] - 5000}),
            "protocol_4": (True, {"protocol": 4}),
            "protocol_6": (True, {"protocol": 6}),
            "capabilities_of_2_mb": (True, {"gap": "x" * 2_000_000}),
            "hostile_gap": (True, {"gap": HOSTILE}),
            "unknown_field": (True, {"temperature_c": 20.0 + self.can_n}),
            "executes_another_forever": (True, {"executing": hex_digest(b"another goal")[:32]}),
        }.get(kind, (False, {}))
        can.update(changed if is_now else {})
        for missing in "simulated", "stopped", "palm":
            if kind == f"{missing}_missing":
                del can[missing]
        return can

    def capabilities(self, query):
        can = self.can()
        self.told = can.get("simulated")
        self.answer(query, b'{"protocol":5,' if self.kind == "capabilities_unreadable" else line(can))

    def signed(self, query, content, key=None):
        key, asked = key or self.key, query.payload
        if self.kind == "protocol_4":
            text = f"cgf cell answer\n{query.key_expr}\n{query.parameters.get('nonce') or ''}\n{hex_digest(content)}"
            return line({"journal": key.public, "signature": key.sign(text.encode())}) + content
        if self.kind == "unsigned_answers":
            head = {"journal": key.public, "asked": hex_digest(b""), "signature": "00" * 64}
            return line(head) + content
        if self.kind == "upper_case_journal":
            name, asked = key.public.upper(), hex_digest(asked.to_bytes() if asked else b"")
            text = answer_text(query.key_expr, query.parameters, asked, content)
            return line({"journal": name, "asked": asked, "signature": key.sign(text)}) + content
        other = {"accepted_of_other_bytes": {"payload": zenoh.ZBytes(b"other bytes") if asked else None},
                 "signs_without_parameters": {"parameters": ""},
                 "signs_another_key_queried": {"key_expr": "cgf/cell/elsewhere/capabilities"}}.get(self.kind, {})
        said = {"key_expr": query.key_expr, "parameters": query.parameters, "payload": asked}
        return super().signed(types.SimpleNamespace(**{**said, **other}), content, key)

    # What it does with goals.

    def goal(self, query):
        data, kind = query.payload.to_bytes() if query.payload else b"", self.kind
        self.goals_n += 1
        _, _, motion = (data.split(b"\n", 2) + [b"", b""])[:3]
        told = "none" if self.told is None else json.dumps(self.told)
        self.note("transmissions", told, hex_digest(motion)[:32])
        is_first = self.goals_n == 1
        if kind in ("real_on_retransmission", "loses_first_transmission") and is_first:
            self.is_real = kind == "real_on_retransmission"
            return self.held.append(query)
        if kind == "loses_goals_keeps_key":
            with self.changed:
                self.changed.wait_for(lambda: not self.executing, 60)
                self.taken.clear()
        answer = self.decide(data)
        if kind == "executes_without_any_answer" or is_first and kind in (
                "executes_without_answer", "loses_goals_keeps_key"):
            return self.held.append(query)
        if answer["answer"] == "accepted" and not answer["known"]:
            if kind.startswith("refuses_but_") or kind == "two_different_answers":
                lie = {"answer": "rejected", "code": "limits", "reason": "it says so, and executes it"}
                if kind == "two_different_answers":
                    query.reply(query.key_expr, self.signed(query, line(answer)))
                answer = lie
            if kind == "answer_not_on_page":
                answer = {"answer": "maybe"}
            if kind == "answer_of_2_mb":
                answer = {**answer, "note": "x" * 2_000_000}
            if kind == "says_known_of_new":
                answer["known"] = True
        if kind == "two_equal_answers":
            query.reply(query.key_expr, self.signed(query, line(answer)))
        content = b'{"answer":"acc' if kind == "answer_unreadable" else line(answer)
        self.answer(query, content, self.other if kind == "accepted_by_another_key" else None)

    def decide(self, data):
        kind = self.kind
        if kind == "hostile_refusal":
            return {"answer": "rejected", "code": "\u202elimits\x1b[2J", "reason": HOSTILE}
        if kind == "executes_another_forever":
            return {"answer": "rejected", "code": "busy", "reason": "another goal is executed"}
        if kind.startswith("refuses_") and kind != "refuses_but_executes":
            return {"answer": "rejected", "code": kind.removeprefix("refuses_"), "reason": "it says so"}
        if kind in ("accepts_then_denies", "accepted_of_other_bytes"):
            return {"answer": "accepted", "known": False}
        return super().decide(data)

    def play(self, goal):
        if self.kind == "accepts_never_executes":
            threading.Event().wait()
        data = super().play(goal)
        self.note("executed", goal.id, self.true_outcome)
        return data

    # What it reports.

    def result(self, query):
        kind = self.kind
        if kind == "never_answers_result":
            return self.held.append(query)
        self.asked_n += 1
        if kind == "never_taken_once" and self.asked_n == 1:
            return self.word(query, "never_taken")
        if kind == "other_journal_before_report":
            self.key = self.other
        super().result(query)

    def answer_report(self, query, data):
        kind, is_short = self.kind, query.parameters.get("samples") == "none"
        if kind == "executes_then_denies":
            return self.word(query, "never_taken")
        if kind == "report_of_70_mb":
            self.answer(query, data)
        elif kind == "first_line_only" and not is_short:
            self.held.append(query)
        else:
            super().answer_report(query, data)
        self.reported_n += 1
        if kind == "other_journal_after_goal":
            self.key = self.other
        if kind == "reports_then_forgets" and self.taken:
            self.taken.clear()
            self.listed.write_text("")

    def contradict(self, goal, outcome, message, lift_m, joints, samples):
        kind, n = self.kind, len(joints)
        if kind in ("outcome_aborted", "outcome_stopped"):
            samples = samples[:len(samples) // 2]
            outcome, message, lift_m = kind.removeprefix("outcome_"), "half of it", samples[-1, 10] - samples[0, 10]
        self.true_outcome = outcome
        if kind == "samples_not_numbers":
            samples[5, 3] = np.nan
        elif kind == "commands_of_another_goal":
            samples[:, 15 + n:] = samples[::-1, 15 + n:]
        elif kind == "palm_elsewhere":
            samples[:, 1] += 0.5
        elif kind == "object_elsewhere":
            samples[:, 8] += 0.5
        elif kind == "object_rises_alone":
            grasp = goal.head["grasp"]
            samples[samples[:, 0] > grasp["reach_s"], 1:8] = samples[samples[:, 0] <= grasp["reach_s"]][-1, 1:8]
        elif kind == "stale_report_renamed":
            if self.first_samples is not None:
                samples = self.first_samples
            self.first_samples = samples
        elif kind in ("report_of_70_mb", "report_of_70_mb_has_line"):
            times = np.linspace(0, samples[-1, 0], LONG // (8 * samples.shape[1]) + 1)
            samples = samples[np.searchsorted(samples[:, 0], times, "right") - 1]
            samples[:, 0] = times
        lift_m = 1e300 if kind == "lift_1e300" else lift_m
        outcome = {"report_unknown": "unknown", "outcome_not_on_page": "exploded",
                   "outcome_rejected": "rejected"}.get(kind, outcome)
        message = HOSTILE if kind == "hostile_message" else message
        return super().contradict(goal, outcome, message, lift_m, joints, samples)

    def report(self, id, outcome, message, lift_m, joints, samples):
        data, kind = super().report(id, outcome, message, lift_m, joints, samples), self.kind
        head, rows = split(data)
        if kind == "report_of_another_goal":
            head["goal_id"] = hex_digest(b"another goal")[:32]
        elif kind == "samples_n_wrong":
            head["samples_n"] += 1
        elif kind == "report_without_message":
            del head["message"]
        elif kind == "lift_not_a_number":
            head["lift_m"] = float("nan")
        elif kind == "report_unreadable":
            return b'{"goal_id":' + bytes(range(256))
        return line(head) + rows

    def outcome(self, n):
        try:
            return super().outcome(n)
        except (ValueError, KeyError):  # it cannot read its own report
            said = {"goal_id": self.taken[n], "outcome": "unknown", "message": "", "lift_m": 0.0}
            return line({"journal": self.key.public, "result_n": n, **said})

    def publish(self, goal, outcome):
        if self.kind == "false_outcome_published":
            outcome = line({**split(outcome)[0], "outcome": "failed", "lift_m": -5.0, "result_n": 77})
        super().publish(goal, outcome)

    def results(self, query):
        if self.kind != "false_results":
            return super().results(query)
        said = {"goal_id": "00" * 16, "outcome": "failed", "message": "", "lift_m": 0.0}
        body = line({"journal": self.key.public, "results_n": 10**15})
        self.answer(query, body + 3 * line({"journal": self.other.public, "result_n": 2**63, **said}))

    def cancel(self, query):
        if self.kind == "never_answers_cancel":
            return self.held.append(query)
        if self.kind == "answers_cancel_while_moving":
            return self.word(query, "done")
        super().cancel(query)


if __name__ == "__main__":
    if "--list" in sys.argv:
        print(*KINDS, sep="\n")
        sys.exit()
    parser = arguments()
    parser.description = __doc__
    parser.add_argument("--misbehave", choices=KINDS, required=True, metavar="KIND", help="in which way; see `--list`")
    parser.add_argument("--list", action="store_true", help="prints the kinds, one per line")
    MisbehavingCell(parser.parse_args()).serve()
