"""Reading whole files: Kurs, the crate `rinex`, georinex, convbin; numbers read, processor time and memory of a process."""

import glob
import os
import sys
import tempfile

import rtklib
from programs import measured

#: Name, file, whether georinex reads it in less than a minute.
FILES = [
    ("RINEX 2, one system, half an hour", "upc2011/UPC20770.11o", True),
    ("RINEX 3, five systems, 301 s", "matrtklib_static/rover.obs", True),
    ("RINEX 2 by teqc, under trees", "canopy2025/MOZA_2025001_00.obs.gz", True),
    ("CRINEX 3, a quarter of an hour", "formats/GRAS00FRA_R_20223151700_15M_01S_MO.crx.gz", False),
    ("RTCM 3, a day", "shadow2026/base_all.rtcm3.gz", False),
]
HEAD = (
    "| file | unpacked, MB | reader | numbers | processor, s | memory, MB |\n"
    "|---|---|---|---|---|---|"
)
GEORINEX = """
import sys, warnings
warnings.simplefilter("ignore")
import georinex
table = georinex.load(sys.argv[1])
print(sum(int(table[name].notnull().sum()) for name in table.data_vars))
"""


def table(options):
    rows = [HEAD]
    readers = sorted(glob.glob("tests-referees/target/release/deps/reading-*[!.d]"), key=os.path.getmtime)
    with tempfile.TemporaryDirectory() as work:
        for name, file, with_georinex in FILES:
            path = f"{options.data}/{file}"
            if not os.path.exists(path):
                rows.append(f"| {name} | | skipped: no {file} | | | |")
                continue
            if not options.wants(file):
                continue
            plain = rtklib.unpacked(path, work) if path.endswith(".gz") else path
            size_mb = os.path.getsize(plain) / 1e6
            for reader, (cost, numbers) in read(options, plain, readers[-1:], with_georinex, work):
                rows.append(f"| {name} | {size_mb:.1f} | {reader} | {numbers} | {cost.processor_s:.3f} | {cost.memory_mb:.0f} |")
    if not readers:
        rows.append("\nskipped: the readers of tests-referees are not built (bench/versus/install)")
    return "\n".join(rows), None


def read(options, path, readers, with_georinex, work):
    """Reader in words, its cost and what it read."""
    cost, _, _ = measured([options.kurs, "inspect", path, "--out", f"{work}/inspect"])
    yield "`kurs inspect`", (cost, "–")
    log = path.endswith(".rtcm3")
    if readers and not log:
        for reader, words in (("kurs", "Kurs, the library"), ("rinex", "crate `rinex`")):
            cost, status, said = measured([*readers, "--one", reader, path])
            yield words, (cost, said.split()[-1] if status == 0 and said.split() else "fails")
    # convbin takes compact files for damaged ones.
    if rtklib.is_there() and not path.endswith(".crx"):
        of_log = ["-r", "rtcm3", "-tr", "2026/06/26", "16:00:00"] if log else ["-r", "rinex"]
        command = ["convbin", *of_log, "-v", "3.04", "-od", "-os", "-o", f"{work}/convbin.obs", "-n", f"{work}/convbin.nav", path]
        yield "`convbin`, which also writes", (measured(command)[0], "–")
    if with_georinex:
        cost, status, said = measured([sys.executable, "-c", GEORINEX, path])
        yield "georinex", (cost, said.split()[-1] if status == 0 else "skipped: " + said.strip().splitlines()[-1])
