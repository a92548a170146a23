"""Observations of two antennas with a known truth: the shared recordings and simulated sessions."""

import glob
import json
import os
import re
import subprocess
import tomllib
from dataclasses import dataclass
from typing import Callable

import judging
from programs import table, time


@dataclass
class Session:
    """Files of a base and a rover, and where the rover is."""

    name: str
    bases: list
    rovers: list
    navigation: list
    #: East, north, up from base to rover at a time (week, second), m.
    truth_m: Callable
    #: The rover on the body, the base at its origin, and how well that is known, m.
    place_m: tuple
    place_sd_m: float
    floor_m: float = judging.FLOOR_M
    #: Approximate time of logs that have none, as convbin wants it.
    start: tuple = ()

    def errors(self, baseline):
        """Errors of a row of baselines.csv and their standard deviations, m."""
        truth = self.truth_m(time(baseline))
        off_m = [float(baseline[f"{c}_m"]) - t for c, t in zip(("east", "north", "up"), truth)]
        return off_m, [float(baseline[f"sd_{c}_m"]) for c in ("east", "north", "up")]

    def configuration(self, keys, with_places):
        """The session for `kurs solve`; keys of [solve] last."""
        text = ""
        for antenna, files, place_m in (("base", self.bases, (0.0, 0.0, 0.0)), ("rover", self.rovers, self.place_m)):
            text += f'[[antenna]]\nname = "{antenna}"\nobs = {json.dumps(files)}\n'
            if with_places:
                text += f"position_m = {list(place_m)}\n"
        if self.navigation:
            text += f"[nav]\nfiles = {json.dumps(self.navigation)}\n"
        return text + "[solve]\n" + "".join(f"{k} = {json.dumps(v)}\n" for k, v in keys.items())


#: Recordings: east, north, up, and how well lengths are told to the programs, m (README of the recordings).
PLACES = {
    "matrtklib": ((-0.2235, -0.9645, 0.009), 0.99, 0.002),
    "upc2011": ((-27.4088, -26.2188, -0.0403), 37.93, 0.01),
    "geonet2005": ((953.6729, -3196.1390, 4.6514), 3335.39, 0.01),
    "canopy": ((-51.195, -35.935, -35.036), 71.69, 0.01),
    "shadow": ((72.4228, -204.3063, -4.9550), 216.82, 0.01),
}


def recording(name, data):
    """A shared recording."""
    data = os.path.abspath(data)
    hours = lambda who: sorted(glob.glob(f"{data}/canopy2025/{who}_*.obs.gz"))
    bases, rovers, navigation = {
        "matrtklib": (["matrtklib_static/base.obs"], ["matrtklib_static/rover.obs"], ["matrtklib_static/base.nav"]),
        "upc2011": (["upc2011/UPC10770.11o"], ["upc2011/UPC20770.11o"], ["upc2011/brdc0770.11n"]),
        "geonet2005": (["geonet2005/07590920.05o"], ["geonet2005/30400920.05o"], ["geonet2005/30400920.05n"]),
        "canopy": (hours("MOZR"), hours("MOZA"), ["canopy2025/brdc_2025001.rnx.gz"]),
        "shadow": (["shadow2026/base_all.rtcm3.gz"], ["shadow2026/rover_all.rtcm3.gz"], []),
    }[name]
    here = lambda files: [os.path.join(data, file) for file in files]
    truth, length_m, sd_m = PLACES[name]
    return Session(
        name, here(bases), here(rovers), here(navigation), lambda _: truth, (length_m, 0.0, 0.0), sd_m,
        # The points under the canopy are known to 1 cm only.
        floor_m=0.06 if name == "canopy" else judging.FLOOR_M,
        start=("2026/06/26", "16:00:00") if name == "shadow" else (),
    )


def simulated(kurs, name, number, folder):
    """A ready scenario with the seed and the hour of its session `number`: the first two antennas, and the configuration of all."""
    with open(f"scenarios/{name}.toml") as file:
        scenario = file.read()
    if number:
        scenario = re.sub(r"^seed = (\d+)", lambda m: f"seed = {int(m[1]) + 1000 * number}", scenario, count=1, flags=re.M)
        scenario = re.sub(r"^start = .*", f'start = "2024-03-10T{(12 + 5 * number) % 24:02}:00:00"', scenario, flags=re.M)
    os.makedirs(folder, exist_ok=True)
    with open(f"{folder}/scenario.toml", "w") as file:
        file.write(scenario)
    subprocess.run([kurs, "simulate", f"{folder}/scenario.toml", "--quiet", "--out", folder], check=True)
    truth = {time(row): [float(row[f"A1_{c}_m"]) for c in ("east", "north", "up")] for row in table(f"{folder}/truth.csv")}
    with open(f"{folder}/kurs.toml") as file:
        text = file.read()
    antennas = tomllib.loads(text)["antenna"]
    here = lambda files: [os.path.join(folder, file) for file in files]
    session = Session(
        name, here(antennas[0]["obs"]), here(antennas[1]["obs"]), here(tomllib.loads(text)["nav"]["files"]),
        truth.__getitem__, tuple(antennas[1]["position_m"]), 0.002,
    )
    text = re.sub(r'"([^"]*\.(rnx|crx|ubx|sbf|rtcm3)[^"]*)"', lambda m: f'"{folder}/{m[1]}"', text)
    return session, text if "[solve]" in text else text + "\n[solve]\n"
