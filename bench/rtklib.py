"""RTKLIB beside Kurs: rnx2rtkp and convbin (Debian's package rtklib)."""

import dataclasses
import gzip
import os
import shutil
import subprocess
from dataclasses import dataclass

from programs import measured

#: Of what rnx2rtkp prints; with a known length its standard deviations are often less.
LAST_DIGIT_M = 1e-4
SYSTEMS = {"G": 1, "R": 4, "E": 8, "J": 16, "C": 32}


def is_there():
    return all(shutil.which(program) for program in ("rnx2rtkp", "convbin"))


@dataclass
class Settings:
    """A moving base with broadcast orbits, accepted at a ratio of 3."""

    systems: str
    #: In RTKLIB's words: l1, l1+2, l1+2+3.
    bands: str
    mask_deg: float = 15.0
    continuous: bool = False
    length_m: float = 0.0
    length_sd_m: float = 0.0

    def text(self):
        pairs = {
            "pos1-posmode": "movingbase", "pos1-frequency": self.bands, "pos1-soltype": "forward",
            "pos1-elmask": self.mask_deg, "pos1-dynamics": "off", "pos1-ionoopt": "brdc", "pos1-tropopt": "saas",
            "pos1-sateph": "brdc", "pos1-navsys": sum(SYSTEMS[system] for system in self.systems),
            "pos2-armode": "continuous" if self.continuous else "instantaneous",
            "pos2-gloarmode": "on" if "R" in self.systems else "off", "pos2-bdsarmode": "on", "pos2-arthres": 3,
            "pos2-arminfix": 10, "out-solformat": "enu", "out-outhead": "on", "out-timesys": "gpst",
            "out-timeform": "tow", "out-timendec": 3, "ant1-postype": "llh", "ant2-postype": "single",
        }
        if self.length_m:
            pairs |= {"pos2-baselen": self.length_m, "pos2-basesig": self.length_sd_m}
        return "".join(f"{key}={value}\n" for key, value in pairs.items())


def solve(session, settings, folder):
    """Rows of rnx2rtkp, (time, fixed or not, east north up, their standard deviations), and its cost."""
    with open(f"{folder}/rtklib.conf", "w") as file:
        file.write(settings.text())
    out = f"{folder}/rtklib.pos"
    command = ["rnx2rtkp", "-k", f"{folder}/rtklib.conf", "-o", out]
    cost, _, _ = measured([*command, joined(session.rovers), joined(session.bases), *session.navigation])
    rows = []
    with open(out) as file:
        for line in file:
            words = line.split()
            if not line.startswith("%") and len(words) >= 10:
                at = int(words[0]), round(float(words[1]), 2)
                sd_m = [max(float(v), LAST_DIGIT_M / 2) for v in words[7:10]]
                rows.append((at, words[5] == "1", [float(v) for v in words[2:5]], sd_m))
    return rows, cost


def joined(files):
    """Several files of one receiver: RTKLIB wants a pattern."""
    if len(files) == 1:
        return files[0]
    begin, end = os.path.commonprefix(files), os.path.commonprefix([file[::-1] for file in files])[::-1]
    return f"{begin}*{end}"


def as_rinex(session, folder):
    """The session in plain RINEX files, which both programs can read; logs by convbin."""
    os.makedirs(folder, exist_ok=True)
    if session.start:
        (base, navigation), (rover, _) = (converted(files[0], session.start, folder) for files in (session.bases, session.rovers))
        return dataclasses.replace(session, bases=[base], rovers=[rover], navigation=[navigation])
    plain = lambda files: [unpacked(file, folder) if file.endswith(".gz") else file for file in files]
    return dataclasses.replace(
        session, bases=plain(session.bases), rovers=plain(session.rovers), navigation=plain(session.navigation)
    )


def converted(log, start, folder):
    """Observation and navigation file that convbin makes of an RTCM 3 log."""
    plain = unpacked(log, folder)
    observations, navigation = f"{plain}.obs", f"{plain}.nav"
    if not os.path.exists(observations):
        command = ["convbin", "-r", "rtcm3", "-v", "3.04", "-od", "-os", "-o", observations, "-n", navigation, "-tr", *start, plain]
        subprocess.run(command, capture_output=True)
    return observations, navigation


def unpacked(path, folder):
    target = f"{folder}/{os.path.basename(path)[:-3]}"
    if not os.path.exists(target):
        with gzip.open(path) as packed, open(target, "wb") as file:
            shutil.copyfileobj(packed, file)
    return target
