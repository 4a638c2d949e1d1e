"""A robot cell with a hand that flies, as the protocol's page has it: it plays goals without physics.

The object rises with the palm where the fingers have closed on it.
"""
import argparse, os, pathlib, secrets, threading, time
import xml.etree.ElementTree as xml
import numpy as np
from checks import PALM, Checks
from wire import PROTOCOL, Goal, Key, between, hex_digest, line, session, signed_text, split

MOST_BYTES, SILENCE_S, HOLD_S = 8 << 20, 0.25, 0.5
KINDS = ["no_samples", "frozen", "lift_minus_5", "lift_1e308", "times_back", "joints_order", "narrow", "short",
         "second_answerer"]


class Refusal(Exception):
    """Why a goal is not taken: its code and its reason."""


class Cell(Checks):
    def __init__(self, args):
        self.args, urdf = args, pathlib.Path(args.hand).read_bytes()
        moving = [j for j in xml.fromstring(urdf).iter("joint") if j.get("type") in ("revolute", "prismatic")]
        limit = {j.get("name"): j.find("limit") for j in moving}
        self.limits = {name: [float(at.get(k)) for k in ("lower", "upper", "velocity")] for name, at in limit.items()}
        self.robot, self.folder = hex_digest(urdf), pathlib.Path(args.journal)
        self.folder.mkdir(parents=True, exist_ok=True)
        if not (self.folder / "key").exists():
            self.write("key", secrets.token_bytes(32))
        self.key = Key((self.folder / "key").read_bytes())
        self.journal, self.epoch = self.key.public.hex(), secrets.token_hex(8)
        self.lock = threading.RLock()
        self.changed = threading.Condition(self.lock)
        taken = self.folder / "taken"
        self.taken = taken.read_text().split() if taken.exists() else []
        self.executing, self.stopped, self.wish, self.waiting = None, False, None, []
        self.dispatcher, self.heard, self.seq, self.kept = None, 0.0, 0, []
        for id in self.taken:  # one in which it went down
            if not (self.folder / f"{id}.report").exists():
                self.write(f"{id}.report", self.report(id, "unknown", "the cell went down", 0.0, [], []))

    def write(self, name, data):
        with open(self.folder / f"{name}.new", "wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        os.replace(self.folder / f"{name}.new", self.folder / name)
        folder = os.open(self.folder, os.O_RDONLY)
        os.fsync(folder)
        os.close(folder)

    def report(self, id, outcome, message, lift_m, joints, samples):
        head = {"goal_id": id, "outcome": outcome, "message": message, "lift_m": lift_m, "joints": joints}
        return line(head) + np.asarray(samples, "<f8").tobytes()

    def serve(self):
        where = self.args.listen or self.args.connect
        self.session = session(where, listens=bool(self.args.listen))
        self.base = f"cgf/cell/{self.args.name}/"
        if list(self.session.get(self.base + "capabilities?nonce=0", timeout=1.0)):
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

    def answer(self, query, body, key=None):
        key, text = key or self.key, str(query.key_expr)
        signature = key.sign(signed_text(text, query.parameters.get("nonce") or "", body)).hex()
        query.reply(query.key_expr, line({"journal": key.public.hex(), "signature": signature}) + body)
        query.drop()

    def word(self, query, word):
        self.answer(query, line({"answer": word}))

    def capabilities(self, query):
        hand = {"controller": "hand", "joints": list(self.limits), "rate_hz": 333.0}
        self.answer(query, line({
            "protocol": PROTOCOL, "cell": self.args.name, "journal": self.journal, "robot": self.robot,
            "clock_unix_ms": int(time.time() * 1000), "simulated": True, "palm": PALM,
            "controllers": [{"controller": "palm", "rate_hz": 250.0}, hand], "max_goal_bytes": MOST_BYTES,
            "gap": "no physics", "real_time": self.args.real_time,
            "silence_s": SILENCE_S if self.args.real_time else None}))

    def beat(self, sample):
        with self.lock:
            if split(sample.payload.to_bytes())[0]["dispatcher"] == self.dispatcher:
                self.heard = time.monotonic()

    def goal(self, query):
        try:
            answer = {"answer": "accepted", "known": self.take(query.payload.to_bytes() if query.payload else b"")}
        except Refusal as refusal:
            code, reason = refusal.args
            answer = {"answer": "rejected", "code": code, "reason": reason}
        self.answer(query, line(answer))

    def take(self, data):
        """Takes a goal; returns whether it was known. The order of the refusals is the page's."""
        def refuse(code, reason):
            raise Refusal(code, reason)

        if len(data) > MOST_BYTES:
            refuse("too_large", f"{len(data)} bytes")
        try:
            seal, content = split(data)
            if seal["protocol"] != PROTOCOL:
                refuse("protocol", f"this cell speaks version {PROTOCOL}")
            digest = hex_digest(content)
            if [seal["digest"], seal["goal_id"]] != [digest, digest[:32]]:
                refuse("digest", "digest and id are not those of the content")
            goal = Goal(data)
        except (ValueError, KeyError, TypeError) as err:
            refuse("malformed", f"this is not a goal: {err!r}")
        with self.lock:
            if goal.id in self.taken:
                return True
            if self.executing:
                refuse("busy", f"goal {self.executing.id} is executed")
            self.check(goal, refuse)
            if self.stopped:
                refuse("stopped", "it was stopped and has not been told to resume")
            self.check_time(goal.seal.get("sending"), refuse)
            try:
                self.write(f"{goal.id}.goal", data)
                self.write("taken", "\n".join([*self.taken, goal.id]).encode())
            except OSError as err:
                refuse("storage", str(err))
            self.taken.append(goal.id)
            sending = goal.seal.get("sending") or {}
            self.executing, self.wish, self.dispatcher = goal, None, sending.get("dispatcher")
            self.heard = time.monotonic()
            self.changed.notify_all()
        return False

    def result(self, query):
        id = str(query.key_expr).split("/")[-2]
        with self.lock:
            if id not in self.taken:
                self.word(query, "never_taken")
            elif self.executing and self.executing.id == id:
                self.waiting.append(("report", query))
            else:
                self.answer(query, (self.folder / f"{id}.report").read_bytes())

    def second(self, query):
        """Somebody else's word on a goal, with a key of their own."""
        id = str(query.key_expr).split("/")[-2]
        data = (self.folder / f"{id}.report").read_bytes() if (self.folder / f"{id}.report").exists() else b"{}\n"
        self.answer(query, data, Key(bytes(32)))

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
            start, over = int(query.parameters.get("from") or 0), len(self.taken) - (self.executing is not None)
            body = line({"journal": self.journal, "results_n": over})
            self.answer(query, body + b"".join(self.outcome(n) for n in range(start, min(over, start + 64))))

    def outcome(self, n):
        head, _ = split((self.folder / f"{self.taken[n]}.report").read_bytes())
        head.pop("joints")
        return line({"journal": self.journal, "result_n": n, **head})

    def history(self, query):
        with self.lock:
            found = [kept for kept in self.kept if kept[1] >= int(query.parameters.get("from") or 0)]
            found = [kept for kept in found if kept[0] == found[0][0]][:512]
            id, seq = found[0][:2] if found else ("", self.seq)
            self.answer(query, self.state(id, seq, [row for _, _, row in found]))

    def state(self, id, seq, samples):
        head = {"epoch": self.epoch, "goal_id": id, "seq": seq, "joints": list(self.limits)}
        return line(head) + np.asarray(samples, "<f8").tobytes()

    def show(self, id, joints, row):
        """Publishes a sample, with its joints in the cell's order."""
        n, order = len(joints), [joints.index(name) for name in self.limits]
        row = [*row[:15], *(row[15 + i] for i in order), *(row[15 + n + i] for i in order)]
        with self.lock:
            self.session.put(self.base + "state", self.state(id, self.seq, [row]))
            self.kept = [*self.kept[-2999:], (id, self.seq, row)]
            self.seq += 1

    def work(self):
        still = np.array([0, *[0, 0, 0, 0, 0, 0, 1] * 2, *[0] * 2 * len(self.limits)], float)
        while True:
            with self.lock:
                self.changed.wait_for(lambda: self.executing, 0.01 if self.args.real_time else None)
                goal = self.executing
            if goal is None:
                self.show("", list(self.limits), still)
                continue
            data = self.play(goal)
            with self.lock:
                self.write(f"{goal.id}.report", data)
                waiting, self.waiting, self.executing = self.waiting, [], None
                for kind, query in waiting:
                    self.answer(query, data if kind == "report" else line({"answer": "over"}))
                outcome = self.outcome(len(self.taken) - 1)
            self.session.put(self.base + f"goal/{goal.id}/outcome", outcome)

    def play(self, goal):
        """Carries a goal out and returns the report."""
        n, grasp = len(goal.joints), goal.head["grasp"]
        hand = goal.hand[:, 0], goal.hand[:, 1:n + 1], goal.hand[:, n + 1:2 * n + 1], goal.hand[:, 2 * n + 1:]
        palm, parts = goal.palm, (goal.palm[:, 0], goal.palm[:, 1:4], goal.palm[:, 8:11], goal.palm[:, 14:17])
        open_s = grasp["reach_s"] * (1 - grasp["close_fraction"])
        closes = abs(hand[1][-1] - between(*hand, open_s)).max() > 1e-3
        lies, start = np.array(goal.head["table_from_object"]), time.monotonic()
        grasp_z = between(*parts, grasp["reach_s"])[2]
        end = sum(grasp[name] for name in ("reach_s", "squeeze_s", "pause_s", "lift_s", "hold_s"))
        samples, broken, at = [], None, 0.0
        while at <= end + 1e-9:
            told = at if broken is None else broken[1]
            q, place = between(*hand, told), between(*parts, told)
            turn = palm[np.clip(np.searchsorted(palm[:, 0], told, "right") - 1, 0, len(palm) - 1), 4:8]
            rise = max(0.0, place[2] - grasp_z) if closes and told > grasp["reach_s"] else 0.0
            samples.append([at, *place, *turn, *(lies + [0, 0, rise, 0, 0, 0, 0]), *q, *q])
            self.show(goal.id, goal.joints, samples[-1])
            if self.args.real_time:
                time.sleep(max(0.0, start + at - time.monotonic()))
            with self.lock:
                silent = self.args.real_time and time.monotonic() - self.heard > SILENCE_S
                if broken is None and (self.wish or silent):
                    broken, end = (self.wish, at), at + HOLD_S
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


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    where = parser.add_mutually_exclusive_group(required=True)
    where.add_argument("--listen", help="endpoint, e.g. tcp/127.0.0.1:7447")
    where.add_argument("--connect", help="a router's endpoint")
    parser.add_argument("--name", default="simulated", help="the cell's name")
    parser.add_argument("--hand", required=True, help="URDF of the hand")
    parser.add_argument("--journal", required=True, help="folder for what it has done")
    parser.add_argument("--object", action="append", help="what lies before it; anything if not given")
    parser.add_argument("--real-time", action="store_true", help="takes as long as goals say")
    parser.add_argument("--contradict", choices=KINDS, help="what its reports contradict")
    Cell(parser.parse_args()).serve()
