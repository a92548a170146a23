// The streams: whether they come, how fast, how late, how strong, what went wrong.

import { byId, duration, write } from "./words.js";

// Rates are those of the last seconds.
const WINDOW_S = 10;
// What a narrow screen writes in front of a value, which has no head of its column there.
const LABELS = ["State", "Rate", "Delay", "Data", "Line", "C/N0 (usual)", "Faults"];

export class Streams {
  // `act(name, what)` is called by the buttons: "restart" or "log".
  constructor(act) {
    this.act = act;
    this.hasLog = false;
    this.lines = new Map();
    this.states = [];
  }

  update(state) {
    this.states.push(state);
    while (this.states.length > 2 && state.utc_ms - this.states[0].utc_ms > WINDOW_S * 1000) this.states.shift();
    state.streams.forEach((stream, number) => this.write(stream, number));
    write(byId("streams-note"), note(state));
  }

  write(stream, number) {
    const cells = this.lines.get(stream.name) ?? this.add(stream.name);
    const rate = (of) => this.rate(number, of);
    const epochs = rate("epochs");
    const bytes = rate("bytes");
    const texts = [
      stream.trouble ?? "well",
      epochs === null ? "–" : `${epochs.toFixed(1)} Hz`,
      stream.age_s === null ? "–" : `${(1000 * stream.age_s).toFixed(0)} ms`,
      bytes === null ? "–" : `${(bytes / 1000).toFixed(1)} kB/s`,
      stream.baud === null ? "–" : `${(100 * stream.line_load).toFixed(0)} % of ${stream.baud}`,
      strengths(stream),
      faults(stream),
    ];
    texts.forEach((text, k) => write(cells[k], text));
    cells[0].className = stream.trouble ? "bad" : "good";
    cells[5].className = stream.bands.some((band) => band.is_low) ? "bad" : "";
  }

  // How much a count grows in a second.
  rate(number, of) {
    const [first, last] = [this.states[0], this.states.at(-1)];
    const seconds = (last.utc_ms - first.utc_ms) / 1000;
    const before = first.streams[number]?.[of];
    if (seconds < 1 || before === undefined) return null;
    return Math.max(0, last.streams[number][of] - before) / seconds;
  }

  add(name) {
    const line = element("tr", "row");
    const head = element("th", "rowheader");
    head.scope = "row";
    head.textContent = name;
    const cells = LABELS.map((label) => {
      const cell = element("td", "cell");
      cell.dataset.label = label;
      return cell;
    });
    const actions = element("td", "cell");
    actions.className = "token";
    actions.append(this.button(name, "restart", "Restart"));
    if (this.hasLog) actions.append(this.button(name, "log", "Save log"));
    line.append(head, ...cells, actions);
    byId("streams-rows").append(line);
    this.lines.set(name, cells);
    return cells;
  }

  button(name, what, text) {
    const button = document.createElement("button");
    button.textContent = text;
    button.setAttribute("aria-label", `${text} ${name}`);
    button.addEventListener("click", () => this.act(name, what));
    return button;
  }
}

// Roles are written out: what is laid out as blocks on a narrow screen is a table all the same.
function element(tag, role) {
  const made = document.createElement(tag);
  made.setAttribute("role", role);
  return made;
}

function strengths({ bands, jamming, spoofing, continuous_wave, gain }) {
  const level = ({ band, cn0_dbhz, usual_dbhz }) => `${band} ${cn0_dbhz.toFixed(0)} (${usual_dbhz.toFixed(0)})`;
  const percent = (share) => `${(100 * share).toFixed(0)} %`;
  return [
    bands.map(level).join(", "),
    jamming !== "unknown" && `jamming: ${jamming}`,
    spoofing !== "unknown" && `spoofing: ${spoofing}`,
    continuous_wave !== null && `continuous wave ${percent(continuous_wave)}`,
    gain !== null && `gain ${percent(gain)}`,
  ].filter(Boolean).join("; ");
}

function faults({ errors, damaged, late, strays, gaps, gaps_s, last_error }) {
  const named = [
    [errors, "connections broke"], [damaged, "pieces damaged"], [late, "epochs late"], [strays, "strays"],
  ].filter(([count]) => count > 0).map(([count, what]) => `${count} ${what}`);
  if (gaps > 0) named.push(`${gaps} gaps, ${duration(gaps_s)}`);
  if (last_error) named.push(`last: ${last_error}`);
  return named.join("; ") || "none";
}

function note({ latency_ms, epoch_latency_ms, station_age_s, unwritten }) {
  const [median, most] = latency_ms;
  const ms = (value) => (value === null ? "more than 10 s" : `${value} ms`);
  return [
    `From the last byte to the row: half within ${ms(median)}, 99 % within ${ms(most)}; from the first byte: ${ms(epoch_latency_ms[0])} and ${ms(epoch_latency_ms[1])}.`,
    station_age_s !== null && `The station's corrections are ${duration(Math.max(0, station_age_s))} old.`,
    unwritten > 0 && `${unwritten} rows could not be written to the files.`,
  ].filter(Boolean).join(" ");
}
