// The array seen from above with the bow up, and in words what the data say of it.

import { Surface, niceStep } from "./canvas.js";
import { byId, metres } from "./words.js";

// Course and heading are compared above this speed, m/s, as a mean over so many rows.
const MOVING_MPS = 1;
const MEMORY_ROWS = 200;
const MIN_ROWS = 40;

export class AntennaArray {
  constructor() {
    this.names = [];
    this.known = [];
    this.offsets = [];
    this.drift = { sine: 0, cosine: 0, count: 0 };
    this.surface = new Surface(byId("array-plot"), (...of) => this.draw(...of));
  }

  setAntennas(antennas) {
    this.names = antennas.map(({ name }) => name);
    this.known = antennas.map(({ position_m }) => position_m);
  }

  // What the course says of the heading: the one thing that shows antennas that were interchanged.
  push(row) {
    if (row.status !== "fixed" || row.heading_deg === null || row.course_deg === null) return;
    if (Math.hypot(row.vel_north_mps, row.vel_east_mps) < MOVING_MPS) return;
    const angle = ((row.course_deg - row.heading_deg) * Math.PI) / 180;
    const drift = this.drift;
    drift.count = Math.min(drift.count + 1, MEMORY_ROWS);
    drift.sine += (Math.sin(angle) - drift.sine) / drift.count;
    drift.cosine += (Math.cos(angle) - drift.cosine) / drift.count;
  }

  update(offsets) {
    this.offsets = offsets;
    const words = [...offsets.map((offset) => this.words(offset)), this.driftWords()].filter(Boolean);
    const list = byId("array-words");
    const text = words.length > 0 ? words : ["Nothing is known of the array before the first heading."];
    if (text.join() !== this.said) {
      this.said = text.join();
      list.replaceChildren(...text.map((line) => Object.assign(document.createElement("li"), { textContent: line })));
    }
    this.surface.ask();
  }

  words({ antenna, forward_m, right_m, length_m }) {
    const along = Math.abs(forward_m) < 0.01 ? "" : `${metres(Math.abs(forward_m))} ${forward_m > 0 ? "ahead" : "astern"}`;
    const across = Math.abs(right_m) < 0.01 ? "" : `${metres(Math.abs(right_m))} to the ${right_m > 0 ? "right" : "left"}`;
    const both = Math.abs(forward_m) >= Math.abs(right_m) ? [along, across] : [across, along];
    const where = both.filter(Boolean).join(" and ") || "at the place";
    const [origin, place] = [this.known[0], this.known[antenna]];
    const off = origin && place ? length_m - Math.hypot(...place.map((value, k) => value - origin[k])) : null;
    const check = off === null ? "" : `; its distance is as configured within ${(1000 * Math.abs(off)).toFixed(0)} mm`;
    return `${this.names[antenna]} is ${where} of ${this.names[0]}${check}.`;
  }

  driftWords() {
    const { sine, cosine, count } = this.drift;
    if (count < MIN_ROWS) return "";
    const angle = (Math.atan2(sine, cosine) * 180) / Math.PI;
    if (Math.abs(angle) > 150) {
      return "It moves with its stern first. If it does not, the antennas are interchanged.";
    }
    if (Math.abs(angle) > 60) {
      const side = angle > 0 ? "right" : "left";
      return `It moves to its ${side}. If it does not, the positions of the antennas are wrong.`;
    }
    return `It moves along its nose, within ${Math.ceil(Math.abs(angle))}°.`;
  }

  draw(context, width, height, colours) {
    const places = [{ antenna: 0, forward_m: 0, right_m: 0 }, ...this.offsets];
    const along = places.map((of) => of.forward_m), across = places.map((of) => of.right_m);
    const middle = (values) => (Math.min(...values) + Math.max(...values)) / 2;
    const span = (values) => Math.max(...values) - Math.min(...values);
    const scale = Math.min((width - 90) / Math.max(span(across), 0.2), (height - 70) / Math.max(span(along), 0.2));
    const x = (of) => width / 2 + (of.right_m - middle(across)) * scale;
    const y = (of) => height / 2 + 6 - (of.forward_m - middle(along)) * scale;
    context.strokeStyle = context.fillStyle = colours.soft;
    context.beginPath();
    context.moveTo(width / 2, 6);
    context.lineTo(width / 2 - 6, 16);
    context.lineTo(width / 2 + 6, 16);
    context.fill();
    context.textAlign = "left";
    context.fillText("ahead", width / 2 + 12, 12);
    const bar = niceStep(60 / scale, 1);
    context.beginPath();
    context.moveTo(8, height - 8);
    context.lineTo(8 + bar * scale, height - 8);
    context.stroke();
    context.fillText(`${bar} m`, 8, height - 18);
    context.strokeStyle = colours.line;
    context.beginPath();
    this.offsets.forEach((of) => {
      context.moveTo(x(places[0]), y(places[0]));
      context.lineTo(x(of), y(of));
    });
    context.stroke();
    for (const of of places) {
      context.fillStyle = of.antenna === 0 ? colours.orange : colours.blue;
      context.beginPath();
      context.arc(x(of), y(of), 6, 0, 2 * Math.PI);
      context.fill();
      context.fillStyle = colours.ink;
      context.fillText(this.names[of.antenna] ?? "", x(of) + 10, y(of));
    }
  }
}
