"""Programs and packages of others that are lacking."""

import os
import sys


def lacking(why):
    """Says so; with KURS_REQUIRE_TOOLS=1, as in .ci/run, that is a failure."""
    print(f"skipped: {why}")
    if os.environ.get("KURS_REQUIRE_TOOLS") == "1":
        sys.exit(1)
