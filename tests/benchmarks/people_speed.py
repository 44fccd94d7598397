"""How long the server takes to answer when many people use the page of a large store at once.

``python tests/benchmarks/people_speed.py [FILE]``: takes a store that ``page_speed.py`` made, or makes one in a
temporary folder; wishes are added to it. One person opens views and has them drawn again, with a second or two to
think; then ten do, while a runner uses both cores. They speak with the server as a browser does, and draw nothing,
since their browsers run elsewhere. Times are medians in ms of the clock.
"""

import argparse
import asyncio
import random
import statistics
import tempfile
import time
from pathlib import Path

import psutil
import websockets
from browser_speed import served
from page_speed import VIEWS, filled
from streamlit.proto.BackMsg_pb2 import BackMsg
from streamlit.proto.ForwardMsg_pb2 import ForwardMsg

from pdlab import experiments, store
from pdlab.experiments import Way

THINK, PEOPLE, LIMIT = 1.5, 10, 3.0
"""Seconds that people think, on average; how many they are; how many times as long they may wait."""
OPENED, AGAIN = "first view", "drawn again"
Times = dict[tuple[str, str], list[float]]


async def answered(socket: websockets.ClientConnection, view: str, query: str, wrong: list[str]) -> float:
    """Ask for a view and return how long it takes until all of it has come [ms]; what went wrong is noted."""
    asked = BackMsg()
    asked.rerun_script.query_string, asked.rerun_script.page_name = query, view
    begin = time.perf_counter()
    await socket.send(asked.SerializeToString())
    while True:
        told = ForwardMsg.FromString(await socket.recv())
        if told.delta.new_element.WhichOneof("type") == "exception":
            wrong.append(told.delta.new_element.exception.message)
        if told.WhichOneof("type") == "script_finished":
            return 1e3 * (time.perf_counter() - begin)


async def person(address: str, end: float, seed: int, times: Times, wrong: list[str]) -> None:
    """Use the page until ``end``, each view in turn, from a random one on, in a new window, drawn again a few times."""
    draw = random.Random(seed)
    views, at = list(VIEWS), draw.randrange(len(VIEWS))
    while time.monotonic() < end:
        view, at = views[at % len(views)], at + 1
        try:
            async with websockets.connect(
                f"ws{address.removeprefix('http')}/_stcore/stream", subprotocols=["streamlit"], max_size=None
            ) as socket:
                for what in (OPENED, AGAIN, AGAIN, AGAIN):
                    query = "&".join(f"{name}={text}" for name, text in draw.choice(VIEWS[view]).items())
                    times.setdefault((view, what), []).append(await answered(socket, view, query, wrong))
                    await asyncio.sleep(draw.expovariate(1.0 / THINK))
        except (OSError, websockets.WebSocketException) as error:
            wrong.append(f"{view}: {error!r}")


async def people(address: str, count: int, seconds: float) -> tuple[Times, list[str]]:
    """Let so many people use the page for some seconds; return their times [ms] and what went wrong."""
    times, wrong, end = Times(), list[str](), time.monotonic() + seconds
    await asyncio.gather(*(person(address, end, seed, times, wrong) for seed in range(count)))
    return times, wrong


def main(path: Path, count: int, seconds: float) -> None:
    """Print how long people wait, one alone and many beside a runner."""
    target = filled(path)
    with served(["pdlab.cli", "serve", "--no-runner"], target.url) as address:
        asyncio.run(people(address, 1, 0.5 * seconds))
        alone, _ = asyncio.run(people(address, 1, seconds))
    with target.read() as session:
        newest = store.newest_engine(session) or 0
    experiments.ask_predictions(target, experiments.to_predict(target, ())[:200], Way(seeds=8), newest)
    target.close()
    with served(["pdlab.cli", "serve"], target.url) as address:
        time.sleep(10.0)  # until the runner is at work
        psutil.cpu_percent()
        together, wrong = asyncio.run(people(address, count, seconds))
        print(f"{count} people for {seconds:.0f} s, processor {psutil.cpu_percent():.0f} % busy, {len(wrong)} errors")
    for sentence in wrong:
        print(f"  {sentence}")
    for key in sorted(together.keys() & alone.keys()):
        many, one = statistics.median(together[key]), statistics.median(alone[key])
        mark = f"   above {LIMIT}" if many > LIMIT * one else ""
        print(f"{many:8.0f} {one:8.0f} {many / one:6.2f}  /{key[0]}, {key[1]} ({len(together[key])} times){mark}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("file", nargs="?", type=Path)
    parser.add_argument("--people", type=int, default=PEOPLE)
    parser.add_argument("--seconds", type=float, default=60.0)
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        main(asked.file or Path(folder) / "lab.db", asked.people, asked.seconds)
