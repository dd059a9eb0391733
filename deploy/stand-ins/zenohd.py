"""Zenoh router in a Python session, for machines without zenohd: ``zenohd.py -c FILE``."""

from __future__ import annotations

import argparse
import signal
import threading

import zenoh


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("-c", "--config", required=True)
    config = zenoh.Config.from_file(parser.parse_args().config)
    stopped = threading.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: stopped.set())
    zenoh.init_log_from_env_or("warn")
    with zenoh.open(config):
        stopped.wait()


if __name__ == "__main__":
    main()
