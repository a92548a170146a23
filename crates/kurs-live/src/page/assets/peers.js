// Other bodies as this one sees them.

import { byId, reason } from "./words.js";

export function show(relative) {
  byId("peers").hidden = relative.length === 0;
  byId("peers-rows").replaceChildren(...relative.map(line));
}

function line(of) {
  const angle = (value, sd) => (value === null ? "–" : `${value.toFixed(2)}°${sd === null ? "" : ` ±${sd.toFixed(2)}`}`);
  const vector = [of.east_m, of.north_m, of.up_m];
  const texts = [
    of.peer,
    angle(of.heading_deg, of.heading_sd_deg),
    angle(of.pitch_deg, of.pitch_sd_deg),
    angle(of.roll_deg, of.roll_sd_deg),
    vector.includes(null) ? "–" : `${vector.map((value) => value.toFixed(2)).join(", ")} m`,
    of.peer_age_s === null ? "–" : `${of.peer_age_s.toFixed(2)} s`,
    of.reason ? `${of.status}: ${reason(of.reason)}` : of.status,
  ];
  const row = document.createElement("tr");
  row.append(...texts.map((text) => Object.assign(document.createElement("td"), { textContent: text })));
  return row;
}
