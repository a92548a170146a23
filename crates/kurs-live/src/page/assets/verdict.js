// One line: is heading good, how good, why not.

import { byId, duration, reason, write } from "./words.js";

// Heading that is less certain than this, degrees, is called uncertain though its integers are right.
const UNCERTAIN_DEG = 2;
// A row is overdue after this many intervals, and after a second.
const OVERDUE_INTERVALS = 5;
// A screen reader is told of a change that stays for so long.
const SETTLED_MS = 2000;

let [said, next, since] = ["", "", 0];

// `link` is the state of the feed; `state` and `row` may be null.
export function show(link, state, row, rowAgeS) {
  const { level, text, more } = judge(link, state, row, rowAgeS);
  const element = byId("verdict");
  if (element.className !== level) element.className = level;
  write(byId("verdict-text"), text);
  write(byId("verdict-more"), more);
  say(level === "good" ? "Heading is good." : `${text} ${level === "poor" ? "" : more}`);
}

function judge(link, state, row, rowAgeS) {
  if (link === "refused") return { level: "none", text: "This page needs the token.", more: "Enter it below." };
  if (link !== "open") return { level: "none", text: "No connection to the service.", more: "Trying again." };
  const troubles = (state?.troubles ?? []).concat(disturbances(state)).join("; ");
  const intervals = (state?.streams ?? []).map((stream) => stream.interval_s);
  const overdueS = Math.max(1, OVERDUE_INTERVALS * Math.max(0, ...intervals));
  if (!row || rowAgeS > overdueS) {
    const age = row ? ` for ${duration(rowAgeS)}` : " yet";
    return { level: "none", text: `No heading: no rows${age}.`, more: troubles };
  }
  const satellites = `${row.satellites ?? 0} satellites`;
  if (row.status === "fixed" && row.heading_deg === null) {
    return { level: "poor", text: "Fixed, but this array does not see the heading.", more: troubles || satellites };
  }
  if (row.status === "fixed") {
    const sd = `±${row.heading_sd_deg.toFixed(2)}°`;
    const isCertain = row.heading_sd_deg <= UNCERTAIN_DEG;
    const text = isCertain ? `Heading is good: ${sd}.` : `Heading is uncertain: ${sd}.`;
    return { level: isCertain ? "good" : "poor", text, more: troubles || satellites };
  }
  const why = reason(row.reason);
  const more = [troubles, satellites].filter(Boolean).join("; ");
  if (row.status === "float") return { level: "poor", text: `No certain heading: ${why}.`, more };
  if (row.status === "inconsistent") return { level: "none", text: `Heading is refused: ${why}.`, more };
  return { level: "none", text: `No heading: ${why}.`, more };
}

function disturbances(state) {
  return (state?.streams ?? []).flatMap((stream) => {
    const low = stream.bands.filter((band) => band.is_low).map((band) => band.band);
    return [
      stream.spoofing === "stated" && `${stream.name} states spoofing`,
      ["warning", "critical"].includes(stream.jamming) && `${stream.name} states jamming (${stream.jamming})`,
      low.length > 0 && `${stream.name} receives ${low.join(", ")} more weakly than usual`,
    ].filter(Boolean);
  });
}

// Numbers change all the time; a screen reader hears only what has changed in kind.
function say(text) {
  const kind = text.replace(/[±]?\d[\d.]*/g, "").trim();
  if (kind !== next) [next, since] = [kind, performance.now()];
  if (kind !== said && performance.now() - since > SETTLED_MS) {
    said = kind;
    write(byId("spoken"), text);
  }
}
