"""Sends a saved goal to a robot cell and says what came of it, as the protocol's page has it.

Beside GOAL it keeps `.sent`, the whole goal as sent, `.accepted`, the cell's signed acceptance, and `.outcome`.
It exits with 1 if the outcome is unknown or nothing was sent. It has no URDF, so it does not compare reports with
the limits of joints.
"""
import argparse, pathlib, secrets, sys, threading, time
import numpy as np, zenoh
from checks import CAPABILITIES, REPORT, check_palm, check_times, fits, opened
from wire import (MOST_REPORT, PROTOCOL, Goal, Key, answer_text, hex_digest, line, palm_at, plain, rows, session, split,
                  verifies, write)

MOST_ANSWER, TRIES = 1 << 20, 2
MAY_CHANGE = "clock_unix_ms", "stopped", "executing"
OUTCOMES = "succeeded", "failed", "aborted", "stopped", "unknown"


class Trouble(Exception):
    """Why nothing is sent any more: the outcome of a motion that was sent is unknown."""


class Contradiction(Trouble):
    """What is wrong with a report that came."""


def check_version(data):
    """Fails if these are capabilities of another version, however they are signed."""
    try:
        spoken = split(split(data)[1])[0].get("protocol", PROTOCOL)
    except ValueError:
        return
    if type(spoken) is int and spoken != PROTOCOL:
        older = "cell" if spoken < PROTOCOL else "dispatcher"
        raise Trouble(f"the cell speaks version {spoken}, this dispatcher {PROTOCOL}: update the {older}")


class Dispatcher:
    def __init__(self, args):
        self.args, self.base = args, f"cgf/cell/{args.name}/"
        self.key = Key(args.key or args.goal.with_name("dispatcher.key"))
        self.name, self.over, self.session = secrets.token_hex(16), threading.Event(), session(args.connect)
        self.journal = self.first = None

    def ask_once(self, key, seconds, payload=b"", parameters="", most=MOST_ANSWER):
        """Returns the cell's answer and what proves it, or nothing twice; whoever else answers is named."""
        key, found = self.base + key, {}
        parameters += f"nonce={secrets.token_hex(16)}"
        replies = self.session.get(
            f"{key}?{parameters}", payload=payload, timeout=seconds, target=zenoh.QueryTarget.ALL,
            consolidation=zenoh.ConsolidationMode.NONE, priority=zenoh.Priority.REAL_TIME)
        for reply in replies:
            if reply.ok is None:
                continue  # a timeout told by a router
            if len(reply.ok.payload) > most:
                raise Trouble(f"{len(reply.ok.payload)} bytes to `{key}`, which were not read")
            data = reply.ok.payload.to_bytes()
            if key.endswith("/capabilities"):
                check_version(data)
            head, content = self.verified(key, parameters, data)
            if head["asked"] != hex_digest(payload):
                raise Trouble(f"journal {head['journal']} answers to other bytes than were sent to `{key}`")
            found[head["journal"], content] = line({"key": key, "parameters": parameters}) + data
        journals = {journal for journal, _ in found}
        if len(found) > 1 or self.journal and journals - {self.journal}:
            raise Trouble(f"{len(found)} different answers to `{key}`, or not of the cell: of journals {journals}")
        for (self.journal, content), proof in found.items():
            return content, proof
        return None, None

    def verified(self, key, parameters, data):
        try:
            head, content = split(data)
            if verifies(head["journal"], answer_text(key, parameters, head["asked"], content), head["signature"]):
                return head, content
        except (ValueError, KeyError):
            pass
        said = plain(data[:60].decode(errors="replace"))
        raise Trouble(f"somebody without a valid signature answers to `{key}`: {said}")

    def ask(self, key):
        until = time.monotonic() + self.args.answer_s
        while time.monotonic() < until:
            content, _ = self.ask_once(key, max(1.0, self.args.answer_s / 2))
            if content is not None:
                return content
            time.sleep(0.1)
        return None

    def capabilities(self):
        """Asks the cell what it is; fails if it is not the one expected, or not what it was at first."""
        asked, content = time.time(), self.ask("capabilities")
        if content is None:
            raise Trouble("no cell answers")
        try:
            can, _ = split(content)
            fits(can, CAPABILITIES, may_lack=["palm", "table_from_base"], may_have_others=True)
        except ValueError as err:
            raise Trouble(f"its capabilities cannot be read: {plain(err)}") from None
        same = {name: can.get(name) for name in CAPABILITIES if name not in MAY_CHANGE}
        self.first = self.first or same
        changed = [f"`{name}` was {self.first[name]} and is {same[name]}" for name in same
                   if same[name] != self.first[name]]
        for is_right, what in [
            (can["cell"] == self.args.name, f"its name is {plain(can['cell'])}"),
            (can["journal"] == self.journal, "it names another journal than the one that signs"),
            (asked - 1 < can["clock_unix_ms"] / 1000 < time.time() + 1, "its clock differs by more than 1 s"),
            (not changed, f"it changed: {plain(' '.join(changed))}"),
        ]:
            if not is_right:
                raise Trouble(f"it is not the cell to be trusted: {what}")
        return can

    def permit(self, goal, can):
        """Fails unless the cell, by its last answer, may be sent the goal."""
        def refuse(code, reason):
            raise Trouble(f"the cell does not fit, `{code}`: {plain(reason)}")

        try:
            offers = {offer["controller"]: offer.get("joints", []) for offer in can["controllers"]}
            if not (can["simulated"] or self.args.execute):
                refuse("permission", "it moves something real, which needs `--execute`")
            if can["stopped"]:
                refuse("stopped", "it was stopped; somebody must resume it")
            if can["robot"] != goal.head["robot"]:
                refuse("robot", f"its robot is {can['robot']}")
            if goal.carrier not in offers or sorted(sum(offers.values(), [])) != sorted(goal.joints):
                refuse("joints", f"it has {offers}")
            for table in goal.carried, goal.hand:
                check_times(table, refuse)
            if goal.carrier == "palm":
                check_palm(goal.carried, can["palm"], refuse)
        except (ValueError, KeyError, TypeError) as err:
            raise Trouble(f"its capabilities cannot be used: {err!r}") from None

    def beat(self):
        while not self.over.wait(0.05):
            self.session.put(self.base + "heartbeat", line({"dispatcher": self.name}))

    def carry_out(self, goal, path):
        """Sends a goal once, whatever becomes of this program; returns the first line of its report."""
        can = self.capabilities()
        threading.Thread(target=self.beat).start()
        for sent in sorted(path.parent.glob("*.sent")):
            try:
                earlier, outcome = Goal(sent.read_bytes()), sent.with_suffix(".outcome")
            except (ValueError, KeyError) as err:
                raise Trouble(f"{sent} keeps no goal of version {PROTOCOL}: {plain(err)}") from None
            is_it, is_here = earlier.id == goal.id, earlier.address["journal"] == self.journal
            if is_it and not is_here:
                raise Trouble(f"it was sent to another journal, {earlier.address['journal']}")
            if sent == path.with_suffix(".sent") and not is_it:
                raise Trouble(f"{sent} keeps another goal")
            if is_here and (is_it or not outcome.exists()):
                report = self.end(earlier)
                if report is None and sent.with_suffix(".accepted").exists():
                    raise Trouble(f"the cell accepted goal {earlier.id} and now denies it")
                if report is not None:
                    write(outcome, line(report))
                    if is_it:
                        return report
        report = self.send(goal, path, can)
        if report["outcome"] != "unknown":
            write(path.with_suffix(".outcome"), line(report))
        return report

    def end(self, goal):
        """Returns what the cell reports on a goal of an earlier run; nothing if it never took it."""
        try:
            return self.report(goal)
        except Contradiction as why:
            return {"outcome": "unknown", "message": str(why)}

    def send(self, goal, path, can):
        self.permit(goal, can)
        now, valid_ms = int(time.time() * 1000), int(self.args.answer_s * 1000)
        message = goal.sent_by(
            self.key, cell=self.args.name, journal=self.journal, dispatcher=self.name,
            simulated_only=not self.args.execute, sent_unix_ms=now, valid_until_unix_ms=now + valid_ms)
        if len(message) > can["max_goal_bytes"]:
            raise Trouble(f"the goal has {len(message)} bytes, the cell takes {can['max_goal_bytes']}")
        path.with_suffix(".outcome").unlink(missing_ok=True)
        write(path.with_suffix(".sent"), message)
        until = time.monotonic() + self.args.answer_s
        content, proof = self.ask_once("goal", self.args.answer_s / 2, message)
        is_repeated = content is None
        while content is None:
            time.sleep(0.1)
            try:
                self.permit(goal, self.capabilities())
            except Trouble as why:
                raise Trouble(f"{why}; it was not sent again") from None
            if time.monotonic() > until:
                raise Trouble("no answer about the goal")
            content, proof = self.ask_once("goal", max(1.0, until - time.monotonic()), message)
        try:
            answer, _ = split(content)
            if answer["answer"] == "rejected":
                return {"outcome": "rejected", "message": plain(f"{answer['code']}: {answer['reason']}")}
        except (ValueError, KeyError) as err:
            raise Trouble(f"its answer about the goal cannot be read: {plain(err)}") from None
        if answer["answer"] != "accepted":
            raise Trouble(f"it answers `{plain(answer['answer'])}` to the goal")
        write(path.with_suffix(".accepted"), proof)
        is_old = answer.get("known") and not is_repeated
        if not is_old:
            self.session.put(self.base + "motion", message)
        report = self.report(goal)
        if report is None:
            raise Trouble("the cell accepted the goal and now denies it")
        return {**report, "message": report["message"] + " (before; nothing has moved now)" * bool(is_old)}

    def cancel(self, goal):
        """Cancels a motion; returns what is known of it."""
        try:
            content = self.ask(f"goal/{goal.id}/cancel")
            if content is None:
                return "the robot may be moving: the cell does not answer"
            words = {"done": "the robot has stopped", "over": "the motion was over", "never_taken": "nothing moved"}
            return words[split(content)[0]["answer"]]
        except (Trouble, ValueError, KeyError, TypeError) as err:
            return f"the robot may be moving: the cell's answer does not count: {plain(err)}"

    def report(self, goal):
        """Waits for the report and returns its first line; nothing if the cell never took the goal."""
        key, unread = f"goal/{goal.id}/result", 0
        until, heard = time.monotonic() + self.args.result_s, time.monotonic()
        while time.monotonic() < min(until, heard + self.args.answer_s):
            seconds = self.args.answer_s if unread else 1.0
            content, _ = self.ask_once(key, seconds, most=MOST_REPORT)
            if content is None and unread >= TRIES:  # the motion is over, and its report does not come
                content, _ = self.ask_once(key, seconds, parameters="samples=none;")
                if content is None:
                    break
                return self.judged(goal, content, has_samples=False)
            if content is not None:
                return self.judged(goal, content)
            content, _ = self.ask_once("capabilities", 1.0)
            if content is None:
                time.sleep(0.1)  # a router that does not know the cell yet tells so at once
            else:
                heard = time.monotonic()
                unread += self.executing(content) != goal.id
        raise Trouble("no answer about the result")

    def executing(self, content):
        try:
            return split(content)[0]["executing"]
        except (ValueError, KeyError) as err:
            raise Trouble(f"its capabilities cannot be read: {plain(err)}") from None

    def judged(self, goal, content, has_samples=True):
        """Returns a report's first line if it contradicts neither its goal nor itself."""
        try:
            head, numbers = split(content)
            if head.get("answer") == "never_taken":
                return None
            fits(head, REPORT, may_lack=["samples_n"], may_have_others=True)
            width = 15 + 2 * len(head["joints"])
            if head["goal_id"] != goal.id or head["outcome"] not in OUTCOMES:
                raise Contradiction(f"its report is about `{plain(head['goal_id'])}`, `{plain(head['outcome'])}`")
            if has_samples:
                self.check(goal, head, rows(numbers, width))
            elif head.get("samples_n", MOST_REPORT) * width * 8 <= MOST_REPORT:
                raise Contradiction(f"its report of {head['samples_n']} samples does not arrive")
        except ValueError as err:
            raise Contradiction(f"its report cannot be read: {plain(err)}") from None
        message = plain(head["message"])
        if not has_samples:
            message += f" (its samples were not read: the longest report that is read has {MOST_REPORT} bytes)"
        return {**head, "message": message}

    def check(self, goal, head, samples):
        grasp, n, end, said = goal.head["grasp"], len(goal.joints), goal.end_s, head["outcome"]
        is_whole, lifted_m = said in ("succeeded", "failed"), grasp["lifted_m"]
        if head.get("samples_n", len(samples)) != len(samples):
            raise Contradiction(f"it has {len(samples)} samples and says {head['samples_n']}")
        if len(samples) == 0:
            if is_whole or abs(head["lift_m"]) > 0.03:
                raise Contradiction(f"it says `{said}` and has no samples")
            return
        if head["joints"] != goal.joints:
            raise Contradiction("its joints are not the goal's")
        times, z, palm_z, q = samples[:, 0], samples[:, 10], samples[:, 3], samples[:, 15:15 + n]
        gaps, rise, high = np.diff(np.concatenate([[0.0], times])), z[-1] - z[0], z - z[0]
        grid = np.arange(0, end + 0.01, 0.005)
        told, palms = goal.positions(grid), palm_at(goal.carried, grid) if goal.carrier == "palm" else None
        arrived = min(grasp["reach_s"], times[-1] - 0.25)
        moved, move = np.ptp(q[times <= arrived + 0.25], axis=0), np.ptp(told[grid <= max(0, arrived - 0.05)], axis=0)
        grasped = [*palm_z[:1], *palm_z[times <= grasp["reach_s"] + 0.1]][-1]
        lies = np.array(goal.head["table_from_object"][:3])
        for is_right, what in [
            ((gaps[1:] > 0).all() and gaps.max() <= 0.1 and times[0] >= 0, "its times"),
            (times[-1] <= end + 5 and (said != "succeeded" or times[-1] >= end - 0.1), "its end"),
            (abs(samples[:, [1, 2, 3, 8, 9, 10]]).max() <= 10, "something is far away"),
            (np.linalg.norm(samples[0, 8:11] - lies) <= 0.3, "the object lay elsewhere"),
            (follows(samples, told, palms, is_whole), "joints or palm were not where the goal has them"),
            (not is_whole or (moved >= 0.02 * move)[move > 0.1].all(), "a joint did not move"),
            (abs(head["lift_m"] - rise) <= 0.03, "the rise is not that of its samples"),
            (said != "succeeded" or head["lift_m"] >= lifted_m, "it was not lifted"),
            (said != "succeeded" or (high[times >= end - grasp["hold_s"] + 0.25] >= lifted_m - 0.01).all(),
             "it was not held"),
            (said != "succeeded" or palm_z[-1] - grasped >= rise / 2, "the palm did not rise"),
        ]:
            if not is_right:
                raise Contradiction(f"its report contradicts its goal or itself: {what}")


def follows(samples, told, palms, is_whole):
    """Whether commands, and a flying palm, are the goal's of about then; of any earlier time if it was aborted."""
    for row in samples:
        last = int(np.clip((row[0] + 0.05) / 0.005 + 2, 1, len(told)))
        first = int(np.clip((row[0] - 0.25) / 0.005, 0, last - 1)) if is_whole else 0
        commands, n = told[first:last], told.shape[1]
        if (row[-n:] < commands.min(0) - 0.05).any() or (row[-n:] > commands.max(0) + 0.05).any():
            return False
        if palms is not None:
            far = np.linalg.norm(palms[first:last, :3] - row[1:4], axis=1)
            turned = 2 * np.arccos(np.clip(abs(palms[first:last, 3:] @ row[4:8]), 0, 1))
            if not ((far <= 0.05) & (turned <= 0.3)).any():
                return False
    return True


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("goal", type=pathlib.Path, help="a goal, as a cell's journal keeps it; of any address")
    parser.add_argument("--connect", required=True, help="endpoint, e.g. tcp/127.0.0.1:7447")
    parser.add_argument("--name", default="simulated", help="the cell's name")
    parser.add_argument("--key", type=pathlib.Path, help="its key, and beside it a .pub; dispatcher.key beside GOAL")
    parser.add_argument("--answer-s", type=float, default=10.0, help="how long the cell may be silent (s)")
    parser.add_argument("--result-s", type=float, default=60.0, help="how long a motion may take (s)")
    parser.add_argument("--execute", action="store_true", help="lets a cell that is not simulated move")
    args = parser.parse_args()

    def refuse(code, reason):
        why = "another version: take one that a newer cell has kept" if code == "protocol" else reason
        sys.exit(f"`{args.goal}` is no goal of version {PROTOCOL}, and nothing was sent: {why}")

    goal = opened(args.goal.read_bytes(), refuse)
    sent, outcome = args.goal.with_suffix(".sent"), args.goal.with_suffix(".outcome")
    try:
        dispatcher = Dispatcher(args)
    except zenoh.ZError as err:
        sys.exit(f"no connection to {args.connect}, and nothing was sent: {err}")
    try:
        report = dispatcher.carry_out(goal, args.goal)
    except Trouble as why:
        is_open = sent.exists() and not outcome.exists()
        sys.exit(f"outcome of goal {goal.id} is unknown; look at the robot: {why}" if is_open
                 else f"nothing was sent: {why}")
    except KeyboardInterrupt:
        sys.exit(f"interrupted: {dispatcher.cancel(goal) if sent.exists() else 'nothing was sent'}")
    finally:
        dispatcher.over.set()
    print(report["outcome"], report["message"])
    if report["outcome"] == "unknown":
        sys.exit(f"outcome of goal {goal.id} is unknown; look at the robot")


if __name__ == "__main__":
    main()
