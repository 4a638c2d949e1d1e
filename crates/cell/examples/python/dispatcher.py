"""Sends a saved goal to a robot cell and says what came of it, as the protocol's page has it."""
import argparse, pathlib, secrets, sys, threading, time
import numpy as np, zenoh
from wire import PROTOCOL, Goal, line, rows, session, signed_text, split, verifies

MOST_ANSWER, MOST_REPORT = 1 << 20, 64 << 20


class Unknown(Exception):
    """Nobody knows what came of the motion: a person looks at the robot."""


class Dispatcher:
    def __init__(self, args):
        self.args, self.base, self.journal = args, f"cgf/cell/{args.name}/", None
        self.name, self.session, self.over = secrets.token_hex(16), session(args.connect), threading.Event()

    def ask_once(self, key, payload, seconds, most):
        """Returns the cell's answer, or nothing; whoever else answers is named."""
        key, nonce, found = self.base + key, secrets.token_hex(16), {}
        replies = self.session.get(
            f"{key}?nonce={nonce}", payload=payload, timeout=seconds, target=zenoh.QueryTarget.ALL,
            consolidation=zenoh.ConsolidationMode.NONE, priority=zenoh.Priority.REAL_TIME)
        for reply in replies:
            if reply.ok is None:
                continue  # a timeout told by a router
            data = reply.ok.payload.to_bytes()
            if len(data) > most:
                raise Unknown(f"{len(data)} bytes to `{key}`")
            head, body = split(data)
            public, signature = bytes.fromhex(head["journal"]), bytes.fromhex(head["signature"])
            if not verifies(public, signed_text(key, nonce, body), signature):
                raise Unknown(f"somebody without a valid signature answers to `{key}`")
            found[head["journal"], body] = body
        journals = {journal for journal, _ in found}
        if len(found) > 1 or self.journal and journals - {self.journal}:
            raise Unknown(f"not one cell answers to `{key}`: {journals}")
        for journal, body in found:
            self.journal = journal
            return body
        return None

    def ask(self, key, payload=b"", most=MOST_ANSWER):
        until = time.monotonic() + self.args.answer_s
        while time.monotonic() < until:
            body = self.ask_once(key, payload, max(1.0, self.args.answer_s / 2), most)
            if body is not None:
                return body
            time.sleep(0.1)
        return None

    def capabilities(self, goal):
        asked = time.time()
        body = self.ask("capabilities")
        if body is None:
            sys.exit("no cell answers; nothing was sent")
        can, _ = split(body)
        clock = can["clock_unix_ms"] / 1000
        offers = {offer["controller"]: offer.get("joints", []) for offer in can["controllers"]}
        for is_right, what in [
            (can["protocol"] == PROTOCOL, "the version"), (can["cell"] == self.args.name, "the name"),
            (can["journal"] == self.journal, "the journal"), (can["robot"] == goal.head["robot"], "the robot"),
            (asked - 1 < clock < time.time() + 1, "the clock"), (goal.carrier in offers, "the controllers"),
            (sorted(sum(offers.values(), [])) == sorted(goal.joints), "the joints"),
            (len(goal.content) < can["max_goal_bytes"], "the longest goal"),
            (can["simulated"] or self.args.execute, "`--execute` of a cell that is not simulated"),
        ]:
            if not is_right:
                sys.exit(f"the cell does not fit: {what}; nothing was sent")

    def beat(self):
        while not self.over.wait(0.05):
            self.session.put(self.base + "heartbeat", line({"dispatcher": self.name}))

    def carry_out(self, goal, sent):
        """Sends a goal once, whatever becomes of this program, and returns the report."""
        if sent.exists():
            if sent.read_text() != self.journal:
                raise Unknown(f"it was sent to the cell with journal {sent.read_text()}")
            report = self.report(goal)
            if report is not None:
                return report
        sent.write_text(self.journal)
        now = int(time.time() * 1000)
        sending = {"dispatcher": self.name, "sent_unix_ms": now,
                   "valid_until_unix_ms": now + int(self.args.answer_s * 1000)}
        message = line({**goal.seal, "sending": sending}) + goal.content
        body = self.ask("goal", message)
        if body is None:
            raise Unknown("no answer about the goal")
        answer, _ = split(body)
        if answer["answer"] != "accepted":
            return {"outcome": "rejected", "message": f"{answer['code']}: {answer['reason']}"}
        if not answer["known"]:
            self.session.put(self.base + "motion", message)
        report = self.report(goal)
        if report is None:
            raise Unknown("the cell accepted the goal and now denies it")
        return report

    def report(self, goal):
        """Waits for the report; nothing if the cell never took the goal."""
        until, heard = time.monotonic() + self.args.result_s, time.monotonic()
        while time.monotonic() < min(until, heard + self.args.answer_s):
            body = self.ask_once(f"goal/{goal.id}/result", b"", 1.0, MOST_REPORT)
            if body is not None:
                head, numbers = split(body)
                if head.get("answer") == "never_taken":
                    return None
                return self.check(goal, head, rows(numbers, 15 + 2 * len(head["joints"])))
            if self.ask_once("capabilities", b"", 1.0, MOST_ANSWER) is not None:
                heard = time.monotonic()
        raise Unknown("no answer about the result")

    def check(self, goal, head, samples):
        """Returns what a report says if it contradicts neither its goal nor itself."""
        grasp, n = goal.head["grasp"], len(goal.joints)
        end = sum(grasp[name] for name in ("reach_s", "squeeze_s", "pause_s", "lift_s", "hold_s"))
        said, is_whole = head["outcome"], head["outcome"] in ("succeeded", "failed")
        if head["goal_id"] != goal.id or said not in ("succeeded", "failed", "aborted", "stopped", "unknown"):
            raise Unknown(f"its report is about `{head['goal_id']}`, `{said}`")
        if len(samples) == 0:
            if is_whole or abs(head["lift_m"]) > 0.03:
                raise Unknown(f"it says `{said}` and has no samples")
            return head
        times, z, palm_z = samples[:, 0], samples[:, 10], samples[:, 3]
        gaps = np.diff(np.concatenate([[0.0], times]))
        rise, hand = z[-1] - z[0], slice(15 + n - goal.hand.shape[1] // 3, 15 + n)
        moved = np.ptp(samples[times <= grasp["reach_s"] + 0.25][:, hand], axis=0)
        told = np.ptp(goal.hand[goal.hand[:, 0] <= grasp["reach_s"] - 0.05][:, 1:1 + len(moved)], axis=0)
        high = z[times >= end - grasp["hold_s"] + 0.25] - z[0]
        grasped = palm_z[times <= grasp["reach_s"] + 0.1][-1]
        lies = np.array(goal.head["table_from_object"][:3])
        for is_right, what in [
            (head["joints"] == goal.joints, "its joints are not the goal's"),
            ((gaps[1:] > 0).all() and gaps.max() <= 0.1 and times[0] >= 0, "its times"),
            (times[-1] <= end + 5 and (said != "succeeded" or times[-1] >= end - 0.1), "its end"),
            (abs(samples[:, [1, 2, 3, 8, 9, 10]]).max() <= 10, "something is far away"),
            (np.linalg.norm(samples[0, 8:11] - lies) <= 0.3, "the object lay elsewhere"),
            (not is_whole or (moved >= 0.1 * told)[told > 0.1].all(), "a joint did not move"),
            (abs(head["lift_m"] - rise) <= 0.03, "the rise is not that of its samples"),
            (said != "succeeded" or head["lift_m"] >= grasp["lifted_m"], "it was not lifted"),
            (said != "succeeded" or (high >= grasp["lifted_m"] - 0.01).all(), "it was not held"),
            (said != "succeeded" or palm_z[-1] - grasped >= rise / 2, "the palm did not rise"),
        ]:
            if not is_right:
                raise Unknown(f"its report contradicts itself: {what}")
        return head


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("goal", type=pathlib.Path, help="file with a goal, as a cell's journal keeps it")
    parser.add_argument("--connect", required=True, help="endpoint, e.g. tcp/127.0.0.1:7447")
    parser.add_argument("--name", default="simulated", help="the cell's name")
    parser.add_argument("--answer-s", type=float, default=10.0, help="how long the cell may be silent (s)")
    parser.add_argument("--result-s", type=float, default=60.0, help="how long a motion may take (s)")
    parser.add_argument("--execute", action="store_true", help="moves a cell that is not simulated")
    args = parser.parse_args()
    goal = Goal(args.goal.read_bytes())
    dispatcher = Dispatcher(args)
    beating = threading.Thread(target=dispatcher.beat)
    try:
        dispatcher.capabilities(goal)
        beating.start()
        report = dispatcher.carry_out(goal, args.goal.with_suffix(".sent"))
        print(report["outcome"], report["message"])
    except Unknown as why:
        sys.exit(f"outcome of goal {goal.id} is unknown; look at the robot: {why}")
    finally:
        dispatcher.over.set()


if __name__ == "__main__":
    main()
