// What happened, newest first, each with its length.

import { byId, duration, reason, write } from "./words.js";

export class Events {
  constructor() {
    this.open = [];
  }

  replace(events, nowMs) {
    this.open = [];
    const lines = events.map((event) => this.line(event, nowMs));
    byId("events-list").replaceChildren(...lines);
  }

  // Those that go on get longer.
  update(nowMs) {
    this.open.forEach(({ element, event }) => write(element, length(event, nowMs)));
  }

  line(event, nowMs) {
    const line = document.createElement("li");
    const parts = ["time", "b", "span"].map((name) => document.createElement(name));
    const began = new Date(event.began_ms);
    parts[0].dateTime = began.toISOString();
    parts[0].textContent = began.toISOString().slice(11, 19);
    parts[1].textContent = length(event, nowMs);
    parts[2].textContent = words(event);
    if (event.length_s === null) {
      line.className = "bad";
      this.open.push({ element: parts[1], event });
    }
    line.append(...parts);
    return line;
  }
}

function words({ kind, text }) {
  if (kind === "gap") return `no heading: ${reason(text)}`;
  return kind === "mark" ? `mark: ${text}` : text;
}

function length({ kind, length_s, began_ms }, nowMs) {
  if (kind === "mark") return "mark";
  return duration(Math.max(0, length_s ?? (nowMs - began_ms) / 1000));
}
