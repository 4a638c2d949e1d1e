"""A robot cell with a hand that flies, as the protocol's page has it: it plays goals without physics.

The object rises with the palm where the fingers have closed on it.
"""
import argparse, pathlib, secrets, threading, time
import xml.etree.ElementTree as xml
import numpy as np
from checks import PALM, check_clock, check_motion, opened
from wire import PROTOCOL, Key, answer_text, hex_digest, line, palm_at, session, split, write

MOST_BYTES, SILENCE_S, HOLD_S = 8 << 20, 0.25, 0.5
KINDS = ["no_samples", "frozen", "lift_minus_5", "lift_1e308", "times_back", "joints_order", "narrow", "short",
         "second_answerer"]


class Refusal(Exception):
    """Why a goal is not taken: its code and its reason."""


def refuse(code, reason):
    raise Refusal(code, reason)


class Cell:
    def __init__(self, args):
        self.args, urdf = args, pathlib.Path(args.hand).read_bytes()
        moving = [j for j in xml.fromstring(urdf).iter("joint") if j.get("type") in ("revolute", "prismatic")]
        limit = {j.get("name"): j.find("limit") for j in moving}
        self.limits = {name: [float(at.get(k)) for k in ("lower", "upper", "velocity")] for name, at in limit.items()}
        self.robot, self.folder = hex_digest(urdf), pathlib.Path(args.journal)
        self.folder.mkdir(parents=True, exist_ok=True)
        self.listed, self.epoch, self.refused = self.folder / "taken", secrets.token_hex(8), {}
        if not self.listed.exists():  # a new journal, or one that has lost its goals
            (self.folder / "key").unlink(missing_ok=True)
            write(self.listed, b"")
        self.key, self.taken = Key(self.folder / "key"), self.listed.read_text().split()
        self.lock = threading.RLock()
        self.changed = threading.Condition(self.lock)
        self.executing, self.stopped, self.wish, self.waiting = None, False, None, []
        self.dispatcher, self.heard, self.seq, self.kept = None, 0.0, 0, []
        self.last = np.array([0, *[0, 0, 0, 0, 0, 0, 1] * 2, *[0] * 2 * len(self.limits)], float)
        for id in self.taken:  # one in which it went down
            if not self.file(id, "report").exists():
                write(self.file(id, "report"), self.report(id, "unknown", "the cell went down", 0.0, [], []))

    def file(self, id, kind):
        return self.folder / f"{id}.{kind}"

    def report(self, id, outcome, message, lift_m, joints, samples):
        head = {"goal_id": id, "outcome": outcome, "message": message, "lift_m": lift_m, "joints": joints}
        return line({**head, "samples_n": len(samples)}) + np.asarray(samples, "<f8").tobytes()

    def serve(self):
        where = self.args.listen or self.args.connect
        self.session = session(where, listens=bool(self.args.listen))
        self.base = f"cgf/cell/{self.args.name}/"
        if any(reply.ok for reply in self.session.get(self.base + "capabilities", timeout=1.0)):
            raise SystemExit("a cell of this name is there already")
        answers = {"capabilities": self.capabilities, "goal": self.goal, "goal/*/result": self.result,
                   "goal/*/cancel": self.cancel, "stop": self.stop, "resume": self.resume,
                   "results": self.results, "state/history": self.history}
        kept = [self.session.declare_queryable(self.base + key, call) for key, call in answers.items()]
        if self.args.contradict == "second_answerer":
            kept.append(self.session.declare_queryable(self.base + "goal/*/result", self.second))
        kept.append(self.session.declare_subscriber(self.base + "heartbeat", self.beat))
        kept.append(self.session.liveliness().declare_token(self.base + "alive"))
        print(where, flush=True)
        self.work()

    def signed(self, query, content, key=None):
        """Returns an answer to a query: the line that signs it, then its content."""
        key, asked = key or self.key, hex_digest(query.payload.to_bytes() if query.payload else b"")
        signature = key.sign(answer_text(query.key_expr, query.parameters, asked, content))
        return line({"journal": key.public, "asked": asked, "signature": signature}) + content

    def answer(self, query, content, key=None):
        query.reply(query.key_expr, self.signed(query, content, key))
        query.drop()

    def word(self, query, word):
        self.answer(query, line({"answer": word}))

    def capabilities(self, query):
        self.answer(query, line(self.can()))

    def can(self):
        goal, hand = self.executing, {"controller": "hand", "joints": list(self.limits), "rate_hz": 333.0}
        return {"protocol": PROTOCOL, "cell": self.args.name, "journal": self.key.public, "robot": self.robot,
                "clock_unix_ms": int(time.time() * 1000), "simulated": not self.args.real, "stopped": self.stopped,
                "executing": goal.id if goal else "", "palm": PALM, "max_goal_bytes": MOST_BYTES,
                "controllers": [{"controller": "palm", "rate_hz": 250.0}, hand], "gap": "no physics",
                "real_time": self.args.real_time, "silence_s": SILENCE_S if self.args.real_time else None}

    def beat(self, sample):
        try:
            if split(sample.payload.to_bytes())[0].get("dispatcher") == self.dispatcher:
                self.heard = time.monotonic()
        except ValueError:
            pass  # no heartbeat

    def goal(self, query):
        self.answer(query, line(self.decide(query.payload.to_bytes() if query.payload else b"")))

    def decide(self, data):
        try:
            return {"answer": "accepted", "known": self.take(data)}
        except Refusal as refusal:
            code, reason = refusal.args
            return {"answer": "rejected", "code": code, "reason": reason[:500]}

    def take(self, data):
        """Takes a goal; returns whether it was known. The order of the refusals is the page's."""
        if len(data) > MOST_BYTES:
            refuse("too_large", f"{len(data)} bytes")
        goal = opened(data, refuse)
        if [goal.address["cell"], goal.address["journal"]] != [self.args.name, self.key.public]:
            refuse("address", f"this is cell `{self.args.name}` with journal {self.key.public}")
        with self.lock:
            if goal.id in self.taken:
                return True
            sealed, now = goal.seal["digest"], time.time() * 1000
            self.refused = {digest: kept for digest, kept in self.refused.items() if kept[0] >= now}
            if sealed in self.refused:  # it stays refused, whatever has changed since
                refuse(*self.refused[sealed][1:])
            try:
                self.admit(goal)
            except Refusal as refusal:
                self.refused[sealed] = goal.address["valid_until_unix_ms"], *refusal.args
                raise
        return False

    def admit(self, goal):
        if self.args.dispatcher and goal.address["dispatcher_key"] not in self.args.dispatcher:
            refuse("dispatcher", "this cell takes goals of other keys only")
        if goal.address["simulated_only"] and self.args.real:
            refuse("permission", "nothing real may move for it, and this cell says that it is real")
        if self.executing:
            refuse("busy", f"goal {self.executing.id} is executed")
        check_motion(goal, self.robot, self.limits, self.args.object, refuse)
        if self.stopped:
            refuse("stopped", "it was stopped and has not been told to resume")
        check_clock(goal.address, refuse)
        try:
            write(self.file(goal.id, "goal"), goal.data)
            write(self.listed, "\n".join([*self.taken, goal.id]).encode())
        except OSError as err:
            refuse("storage", str(err))
        self.taken.append(goal.id)
        self.executing, self.wish, self.dispatcher = goal, None, goal.address["dispatcher"]
        self.heard = time.monotonic()
        self.changed.notify_all()

    def result(self, query):
        id = str(query.key_expr).split("/")[-2]
        with self.lock:
            if id not in self.taken:
                self.word(query, "never_taken")
            elif self.executing and self.executing.id == id:
                self.waiting.append(("report", query))
            else:
                self.answer_report(query, self.file(id, "report").read_bytes())

    def answer_report(self, query, data):
        first = data[:data.index(b"\n") + 1]
        self.answer(query, first if query.parameters.get("samples") == "none" else data)

    def second(self, query):
        """Somebody else's word on a goal, with a key of their own."""
        file = self.file(str(query.key_expr).split("/")[-2], "report")
        self.answer(query, file.read_bytes() if file.exists() else b"{}\n", Key(self.folder / "second"))

    def cancel(self, query):
        id = str(query.key_expr).split("/")[-2]
        with self.lock:
            if self.executing and self.executing.id == id:
                self.wish = self.wish or "canceled"
                self.waiting.append(("end", query))
            else:
                self.word(query, "over" if id in self.taken else "never_taken")

    def stop(self, query):
        with self.lock:
            self.stopped = True
            if not self.executing:
                return self.word(query, "done")
            self.wish = "stopped"
            self.waiting.append(("end", query))

    def resume(self, query):
        with self.lock:
            self.stopped = False
            self.word(query, "done")

    def results(self, query):
        with self.lock:
            start, over = self.start(query), len(self.taken) - (self.executing is not None)
            body = line({"journal": self.key.public, "results_n": over})
            self.answer(query, body + b"".join(self.outcome(n) for n in range(start, min(over, start + 64))))

    def start(self, query):
        """Returns the number from which on a query asks; 0 if it has none."""
        text = query.parameters.get("from") or ""
        return int(text) if text.isdecimal() else 0

    def outcome(self, n):
        head, _ = split(self.file(self.taken[n], "report").read_bytes())
        said = {name: head[name] for name in ("goal_id", "outcome", "message", "lift_m")}
        return line({"journal": self.key.public, "result_n": n, **said})

    def history(self, query):
        with self.lock:
            found = [kept for kept in self.kept if kept[1] >= self.start(query)]
            found = [kept for kept in found if kept[0] == found[0][0]][:512]
            id, seq = found[0][:2] if found else ("", self.seq)
            self.answer(query, self.state(id, seq, [row for _, _, row in found]))

    def state(self, id, seq, samples):
        head = {"epoch": self.epoch, "goal_id": id, "seq": seq, "joints": list(self.limits)}
        return line(head) + np.asarray(samples, "<f8").tobytes()

    def show(self, id, joints, row):
        """Publishes a sample, with its joints in the cell's order."""
        n, order = len(joints), [joints.index(name) for name in self.limits]
        self.last = [*row[:15], *(row[15 + i] for i in order), *(row[15 + n + i] for i in order)]
        with self.lock:
            self.session.put(self.base + "state", self.state(id, self.seq, [self.last]))
            self.kept = [*self.kept[-2999:], (id, self.seq, self.last)]
            self.seq += 1

    def work(self):
        while True:
            with self.lock:
                self.changed.wait_for(lambda: self.executing, 0.01 if self.args.real_time else None)
                goal = self.executing
            if goal is None:
                self.show("", list(self.limits), self.last)
                continue
            data = self.play(goal)
            with self.lock:
                write(self.file(goal.id, "report"), data)
                self.publish(goal, self.outcome(len(self.taken) - 1))
                waiting, self.waiting, self.executing = self.waiting, [], None
                for kind, query in waiting:
                    if kind == "report":
                        self.answer_report(query, data)
                    else:
                        self.word(query, "over")

    def publish(self, goal, outcome):
        self.session.put(self.base + f"goal/{goal.id}/outcome", outcome)

    def play(self, goal):
        """Carries a goal out and returns the report."""
        grasp, lies = goal.head["grasp"], np.array(goal.head["table_from_object"])
        open_s = grasp["reach_s"] * (1 - grasp["close_fraction"])
        closes = abs(goal.hand[-1, 1:1 + len(goal.joints)] - goal.positions(open_s)).max() > 1e-3
        grasp_z, start, end = palm_at(goal.carried, grasp["reach_s"])[2], time.monotonic(), goal.end_s
        samples, broken, at = [], None, 0.0
        while at <= end + 1e-9:
            told = at if broken is None else broken[1]
            q, palm = goal.positions(told), palm_at(goal.carried, told)
            rise = max(0.0, palm[2] - grasp_z) if closes and told > grasp["reach_s"] else 0.0
            samples.append([at, *palm, *(lies + [0, 0, rise, 0, 0, 0, 0]), *q, *q])
            self.show(goal.id, goal.joints, samples[-1])
            if self.args.real_time:
                time.sleep(max(0.0, start + at - time.monotonic()))
            with self.lock:
                silent = self.args.real_time and time.monotonic() - self.heard > SILENCE_S
                if broken is None and (self.wish or silent):
                    broken, end = (self.wish, at), at + HOLD_S
                if broken:  # nothing moves any more
                    asked = [query for kind, query in self.waiting if kind == "end"]
                    self.waiting = [(kind, query) for kind, query in self.waiting if kind != "end"]
                    for query in asked:
                        self.word(query, "done")
            at += 0.01
        outcome = "succeeded" if rise >= grasp["lifted_m"] else "failed"
        if broken:
            outcome = "stopped" if broken[0] else "aborted"
        message = (broken[0] or "no heartbeat of the dispatcher") if broken else "played"
        return self.contradict(goal, outcome, message, rise, goal.joints, np.array(samples))

    def contradict(self, goal, outcome, message, lift_m, joints, samples):
        """Returns the report, or one that contradicts its goal or itself."""
        kind = self.args.contradict
        if kind == "no_samples":
            samples = []
        elif kind == "frozen":
            samples[:, 1:] = samples[0, 1:]
        elif kind == "times_back":
            samples[len(samples) // 2, 0] = 0.0
        elif kind == "joints_order":
            joints = joints[::-1]
        elif kind == "narrow":
            samples = samples[:, :-1]
        elif kind == "short":
            samples = samples[:len(samples) // 2]
        lift_m = {"lift_minus_5": -5.0, "lift_1e308": 1e308}.get(kind, lift_m)
        return self.report(goal.id, outcome, message, lift_m, joints, samples)


def arguments():
    parser = argparse.ArgumentParser(description=__doc__)
    where = parser.add_mutually_exclusive_group(required=True)
    where.add_argument("--listen", help="endpoint, e.g. tcp/127.0.0.1:7447")
    where.add_argument("--connect", help="a router's endpoint")
    parser.add_argument("--name", default="simulated", help="the cell's name")
    parser.add_argument("--hand", required=True, help="URDF of the hand")
    parser.add_argument("--journal", required=True, help="folder for what it has done")
    parser.add_argument("--object", action="append", help="what lies before it; anything if not given")
    parser.add_argument("--dispatcher", action="append", metavar="KEY", help="takes only goals signed with it; may be "
                        "repeated; goals of any key if not given")
    parser.add_argument("--real", action="store_true", help="says that it moves something real, to test a dispatcher")
    parser.add_argument("--real-time", action="store_true", help="takes as long as goals say")
    parser.add_argument("--contradict", choices=KINDS, help="what its reports contradict, to test a dispatcher")
    return parser


if __name__ == "__main__":
    Cell(arguments().parse_args()).serve()
