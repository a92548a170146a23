"""Fixes: kurs solve and rnx2rtkp on the same files, right and wrong, honest or not, what they cost."""

import os
import tempfile

import programs
import rtklib
import sessions
from judging import Score

#: Recording, bands of Kurs, systems and bands of RTKLIB, mask in degrees.
RECORDINGS = [
    ("matrtklib", "G1", "G", "l1", 15),
    ("matrtklib", "E1", "E", "l1", 15),
    ("matrtklib", "R1,R2", "R", "l1+2", 15),
    ("matrtklib", "G1,E1,C2", "GEC", "l1", 15),
    ("matrtklib", "G1,G2,E1,E5,C2,C7", "GEC", "l1+2", 15),
    ("upc2011", "G1", "G", "l1", 15),
    ("upc2011", "G1", "G", "l1", 20),
    ("upc2011", "G1,G2", "G", "l1+2", 15),
    ("geonet2005", "G1", "G", "l1", 15),
    ("geonet2005", "G1,G2", "G", "l1+2", 15),
    ("canopy", "G1", "G", "l1", 15),
    ("canopy", "G1,G2,E1", "GE", "l1+2", 10),
    ("canopy", "G1,G2,E1,R1,R2", "GRE", "l1+2", 10),
    ("shadow", "C2", "C", "l1", 15),
    ("shadow", "C2,C6,C7", "C", "l1+2+3", 15),
]
#: Scenario, bands of Kurs, systems and bands of RTKLIB, mask in degrees.
SCENARIOS = [
    ("roof-static", "", "GREC", "l1+2", 10),
    ("car", "", "GEC", "l1+2", 10),
    ("ship", "", "GEC", "l1+2", 10),
    ("uav", "", "GEC", "l1+2", 10),
    ("few-satellites", "", "G", "l1+2", 10),
    ("edge", "", "GE", "l1", 10),
    ("canopy", "", "GE", "l1", 10),
    ("street", "", "GEC", "l1", 10),
    ("urban", "", "GREC", "l1+2", 10),
]
#: In words, continuous or each epoch alone, with the length or without.
MODES = [
    ("each epoch", False, False),
    ("each epoch, length", False, True),
    ("continuous", True, False),
    ("continuous, length", True, True),
]
#: What README shows: recording or scenario, bands, mode.
EXCERPT = [
    ("`matrtklib`, 1 m", "G1", "each epoch"),
    ("`matrtklib`, 1 m", "E1", "each epoch"),
    ("`matrtklib`, 1 m", "G1,G2,E1,E5,C2,C7", "each epoch"),
    ("`upc2011`, 38 m", "G1", "each epoch"),
    ("`upc2011`, 38 m", "G1", "each epoch, length"),
    ("`geonet2005`, 3335 m", "G1", "each epoch"),
    ("`canopy`, 72 m", "G1,G2,E1", "each epoch"),
    ("`shadow`, 217 m", "C2", "continuous"),
    ("scenario `edge`", "all", "continuous"),
    ("scenario `urban`", "all", "each epoch"),
]
HEAD = (
    "| observations | bands | mode | program | right | wrong | beyond 3 σ | RMS, mm | scatter, mm | processor, s | memory, MB |\n"
    "|---|---|---|---|---|---|---|---|---|---|---|"
)


def table(options):
    """The table, and its excerpt for README."""
    rows = [HEAD]
    excerpt = [HEAD]
    if not rtklib.is_there():
        rows.insert(0, "skipped: RTKLIB (Debian's package rtklib)\n")
    with tempfile.TemporaryDirectory() as work:
        for title, session, bands, settings, whole in cases(options, work):
            for words, continuous, with_length in MODES:
                found = [("Kurs", kurs(options, session, bands, settings.mask_deg, continuous, with_length, work))]
                if whole and not (continuous or with_length):
                    found.append(("Kurs, whole array", kurs_whole(options, session, whole, work)))
                if rtklib.is_there():
                    found.append(("RTKLIB", rnx2rtkp(session, settings, continuous, with_length, work)))
                epochs = found[0][1][1]
                common = set.intersection(*(set(score.errors_m) for _, (score, *_) in found))
                lines = [line(title, bands or "all", words, name, score, common, epochs, cost) for name, (score, _, cost) in found]
                rows += lines
                if (title, bands or "all", words) in EXCERPT:
                    excerpt += lines
                print("\n".join(lines), flush=True)
    return "\n".join(rows), "\n".join(excerpt)


def cases(options, work):
    """Title, session in plain RINEX, bands, RTKLIB's settings, and the configuration of the whole array where there are more antennas."""
    for name, bands, systems, rtklib_bands, mask_deg in RECORDINGS if os.path.isdir(options.data) else []:
        if options.wants(name):
            session = sessions.recording(name, options.data)
            plain = rtklib.as_rinex(session, f"{work}/{name}") if rtklib.is_there() else session
            mask = f", mask {mask_deg}°" if (name, mask_deg) == ("upc2011", 20) else ""
            title = f"`{name}`, {session.place_m[0]:.0f} m{mask}"
            yield title, plain, bands, rtklib.Settings(systems, rtklib_bands, mask_deg), None
    if not os.path.isdir(options.data):
        print(f"skipped: no recordings in {options.data}")
    for name, bands, systems, rtklib_bands, mask_deg in SCENARIOS:
        if options.wants(name):
            session, whole = sessions.simulated(options.kurs, name, 0, f"{work}/scenario-{name}")
            more = whole if whole.count("[[antenna]]") > 2 else None
            yield f"scenario `{name}`", session, bands, rtklib.Settings(systems, rtklib_bands, mask_deg), more


def kurs(options, session, bands, mask_deg, continuous, with_length, work):
    """Score, epochs and cost of the pair alone."""
    keys = {
        "ambiguity": "continuous" if continuous else "instantaneous",
        "constraint": "length" if with_length else "none",
        "elevation_mask_deg": mask_deg,
        "max_tilt_deg": 180,
    }
    if with_length:
        keys["array_sd_m"] = session.place_sd_m
    if bands:
        keys["bands"] = bands.split(",")
    return judged(session, programs.solve(options.kurs, session.configuration(keys, with_places=with_length), work))


def kurs_whole(options, session, text, work):
    """The same baseline where all antennas of the array are used and its shape is known."""
    rows, baselines, cost = programs.solve(options.kurs, text, work)
    return judged(session, (rows, [r for r in baselines if r["rover"] == "A1"], cost))


def judged(session, found):
    rows, baselines, cost = found
    score = Score()
    for baseline in baselines:
        if baseline["status"] == "fixed":
            score.add(*session.errors(baseline), session.floor_m, sessions.time(baseline))
    return score, len(rows), cost


def rnx2rtkp(session, settings, continuous, with_length, work):
    settings.continuous = continuous
    settings.length_m = sum(c * c for c in session.place_m) ** 0.5 if with_length else 0.0
    settings.length_sd_m = session.place_sd_m
    rows, cost = rtklib.solve(session, settings, work)
    score = Score()
    for at, fixed, baseline_m, sd_m in rows:
        if fixed:
            score.add([b - t for b, t in zip(baseline_m, session.truth_m(at))], sd_m, session.floor_m, at)
    return score, len(rows), cost


def line(title, bands, mode, program, score, common, epochs, cost):
    share = lambda count, of: f"{100 * count / of:.1f} %" if of else "–"
    rms = f"{1e3 * score.rms_m:.1f}" if score.right else "–"
    scatter = f"{1e3 * score.scatter_m(common):.1f}" if len(common) > 1 else "–"
    return (
        f"| {title} | {bands} | {mode} | {program} | {share(score.right, epochs)} | {score.wrong} "
        f"| {share(score.beyond, score.fixed)} | {rms} | {scatter} | {cost.processor_s:.2f} | {cost.memory_mb:.0f} |"
    )
