// The sky as each antenna receives it: azimuth, elevation, strength, and what is behind something.

import { Surface } from "./canvas.js";
import { byId, write } from "./words.js";

// So much less than usual, dB, is seen in the picture.
const WEAKER_DB = 2;

export class Sky {
  constructor() {
    this.antennas = [];
    this.sky = null;
  }

  // The names of the antennas are known.
  setAntennas(names) {
    const list = byId("skies");
    list.replaceChildren();
    this.antennas = names.map((name, number) => {
      const figure = document.createElement("figure");
      const canvas = document.createElement("canvas");
      const caption = document.createElement("figcaption");
      canvas.setAttribute("role", "img");
      figure.append(canvas, caption);
      list.append(figure);
      const surface = new Surface(canvas, (...of) => draw(this.sky, number, ...of));
      return { name, canvas, caption, surface };
    });
  }

  update(sky) {
    this.sky = sky;
    this.antennas.forEach(({ name, canvas, caption, surface }, number) => {
      const satellites = sky.antennas[number] ?? [];
      const strengths = satellites.map((of) => of[3]).filter((strength) => strength !== null);
      const mean = strengths.reduce((sum, strength) => sum + strength, 0) / (strengths.length || 1);
      const behind = satellites.filter((of) => of[4] >= sky.behind_db).map((of) => of[0]);
      const unused = satellites.filter((of) => of[4] === null).length;
      const words = [
        `${name}: ${satellites.length} satellites`,
        strengths.length > 0 && `mean C/N0 ${mean.toFixed(0)} dB-Hz`,
        unused > 0 && `${unused} not used`,
        behind.length > 0 && `behind something: ${behind.join(" ")}`,
      ];
      const text = words.filter(Boolean).join(", ");
      write(caption, text);
      canvas.setAttribute("aria-label", text);
      surface.ask();
    });
  }
}

function draw(sky, number, context, width, height, colours) {
  const [x, y] = [width / 2, height / 2];
  const radius = Math.min(x, y) - 12;
  context.strokeStyle = colours.line;
  context.beginPath();
  for (const elevation of [0, 30, 60]) {
    const r = radius * (1 - elevation / 90);
    context.moveTo(x + r, y);
    context.arc(x, y, r, 0, 2 * Math.PI);
  }
  context.moveTo(x - radius, y);
  context.lineTo(x + radius, y);
  context.moveTo(x, y - radius);
  context.lineTo(x, y + radius);
  context.stroke();
  context.fillStyle = colours.soft;
  context.fillText("N", x, y - radius - 6);
  context.font = "10px system-ui, sans-serif";
  const labels = [];
  for (const [name, azimuth, elevation, strength, missing] of sky?.antennas[number] ?? []) {
    if (azimuth === null) continue;
    const r = radius * (1 - elevation / 90);
    const angle = (azimuth * Math.PI) / 180;
    const [px, py] = [x + r * Math.sin(angle), y - r * Math.cos(angle)];
    mark(context, px, py, strength, missing, sky.behind_db, colours);
    context.fillStyle = colours.ink;
    label(context, labels, name, px, py);
  }
}

// A name beside its satellite, at the first place that no other name has; none if there is no such place.
function label(context, taken, name, x, y) {
  for (const [dx, dy] of [[0, 12], [0, -12], [18, 0], [-18, 0]]) {
    const [px, py] = [x + dx, y + dy];
    if (taken.some(([ox, oy]) => Math.abs(px - ox) < 24 && Math.abs(py - oy) < 11)) continue;
    taken.push([px, py]);
    context.fillText(name, px, py);
    return;
  }
}

function mark(context, x, y, strength, missing, behind, colours) {
  const isBehind = missing !== null && missing >= behind;
  context.fillStyle = context.strokeStyle = isBehind ? colours.red : missing === null ? colours.soft : colours.green;
  context.lineWidth = 1.5;
  context.beginPath();
  context.arc(x, y, missing === null ? 2 : size(strength), 0, 2 * Math.PI);
  if (isBehind || missing >= WEAKER_DB) context.stroke();
  if (isBehind) return;
  if (missing >= WEAKER_DB) {
    context.beginPath();
    context.arc(x, y, size(strength), 0, Math.PI);
  }
  context.fill();
}

// 30 dB-Hz is small, 50 is large.
const size = (strength) => 3 + 3 * Math.min(1, Math.max(0, ((strength ?? 30) - 30) / 20));
