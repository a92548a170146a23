"""Reads a Tracking Data Message with the package ccsds-ndm, adds a Doppler record to its first
segment, and writes it in both forms.

    python3 foreign_tdm.py MESSAGE OUT_FOLDER

Exits with 77 if the package is not installed (`pip install ccsds-ndm`).
"""

import copy
import sys
from pathlib import Path

try:
    from ccsds_ndm.mapping import NDMFileFormats
    from ccsds_ndm.ndm_io import NdmIo
except ImportError:
    sys.exit(77)

message, out = sys.argv[1], Path(sys.argv[2])
tdm = NdmIo().from_path(message)
observations = tdm.body.segment[0].data.observation
doppler = copy.deepcopy(observations[0])
doppler.angle_1 = doppler.angle_2 = doppler.range = None
doppler.doppler_instantaneous = type(observations[0].angle_1)(value=-0.25)
observations.append(doppler)
for form, name in [(NDMFileFormats.KVN, "foreign.tdm"), (NDMFileFormats.XML, "foreign.xml")]:
    (out / name).write_text(NdmIo().to_string(tdm, form))
print(sum(len(segment.data.observation) for segment in tdm.body.segment))
