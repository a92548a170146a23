"""Kurs beside others: bench/versus/run."""

import argparse
import os
from dataclasses import dataclass

import pages

from . import fixes, integers, live, reading, relaxation, wahba

PARTS = {
    "fixes": fixes.table,
    "live": live.table,
    "reading": reading.table,
    "wahba": wahba.table,
    "integers": integers.table,
    "relaxation": relaxation.table,
}
PAGE, README, COMMAND = "docs/experiments/versus.md", "README.md", "bench/versus/run"


@dataclass
class Options:
    kurs: str
    data: str
    #: Words of the names of recordings and scenarios; none: all.
    only: list
    quick: bool

    def wants(self, name):
        return not self.only or any(word in name for word in self.only)


def main():
    parser = argparse.ArgumentParser(prog=COMMAND, description="Kurs beside others, on the same bytes, in one run.")
    parser.add_argument("--parts", default=",".join(PARTS), help="of them all, with commas (default: %(default)s)")
    parser.add_argument("--only", default="", help="recordings and scenarios whose name contains one of these words, with commas")
    parser.add_argument("--quick", action="store_true", help="a tenth of the problems, fifteen seconds live")
    parser.add_argument("--write", action="store_true", help=f"into {PAGE}, and the excerpt into {README}")
    arguments = parser.parse_args()
    options = Options(
        kurs=os.environ.get("KURS", "target/release/kurs"),
        data=os.path.abspath(os.environ.get("KURS_DATA", "../shared/data")),
        only=[word for word in arguments.only.split(",") if word],
        quick=arguments.quick,
    )
    for part in arguments.parts.split(","):
        print(f"\n== {part}\n", flush=True)
        text, excerpt = PARTS[part](options)
        if part != "fixes":
            print(text)
        if arguments.write:
            pages.write(PAGE, f"{COMMAND} --parts {part}", text)
            if excerpt:
                pages.write(README, COMMAND, excerpt)


if __name__ == "__main__":
    main()
