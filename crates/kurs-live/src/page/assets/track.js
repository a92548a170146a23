// The track of the last ten minutes on a plain grid: north up, with a scale and the body as an arrow.

import { Surface, niceStep } from "./canvas.js";
import { LATITUDE, LONGITUDE } from "./rows.js";
import { byId } from "./words.js";

// Metres of a degree of latitude; a picture needs no ellipsoid.
const DEGREE_M = 111_320;
// The picture shows no less than this.
const MIN_SPAN_M = 2;
const MARGIN = 16;

export class Track {
  constructor(rows) {
    this.rows = rows;
    this.surface = new Surface(byId("track-plot"), (...of) => this.draw(...of));
  }

  update() {
    this.surface.ask();
  }

  draw(context, width, height, colours) {
    const placed = this.rows.points.filter((point) => point[LATITUDE] !== null);
    if (placed.length === 0) {
      context.fillStyle = colours.soft;
      context.fillText("no position", width / 2, height / 2);
      return;
    }
    const [latitude, longitude] = [placed[0][LATITUDE], placed[0][LONGITUDE]];
    const shrink = Math.cos((latitude * Math.PI) / 180);
    const easts = placed.map((point) => (point[LONGITUDE] - longitude) * DEGREE_M * shrink);
    const norths = placed.map((point) => (point[LATITUDE] - latitude) * DEGREE_M);
    const bounds = (values) => values.reduce(([low, high], v) => [Math.min(low, v), Math.max(high, v)], [0, 0]);
    const [[west, east], [south, north]] = [bounds(easts), bounds(norths)];
    const span = (low, high) => Math.max(high - low, MIN_SPAN_M);
    const scale = Math.min((width - 2 * MARGIN) / span(west, east), (height - 2 * MARGIN) / span(south, north));
    const x = (e) => width / 2 + (e - (west + east) / 2) * scale;
    const y = (n) => height / 2 - (n - (south + north) / 2) * scale;

    grid(context, width, height, colours, x, y, scale);
    context.strokeStyle = colours.blue;
    context.lineWidth = 1.5;
    context.beginPath();
    easts.forEach((e, k) => context.lineTo(x(e), y(norths[k])));
    context.stroke();
    arrow(context, x(easts.at(-1)), y(norths.at(-1)), this.rows.newest, colours);
  }
}

function grid(context, width, height, colours, x, y, scale) {
  const step = niceStep(width / scale, 5);
  const first = (zero) => ((zero % (step * scale)) + step * scale) % (step * scale);
  context.strokeStyle = colours.line;
  context.beginPath();
  for (let at = first(x(0)); at < width; at += step * scale) {
    context.moveTo(at, 0);
    context.lineTo(at, height);
  }
  for (let at = first(y(0)); at < height; at += step * scale) {
    context.moveTo(0, at);
    context.lineTo(width, at);
  }
  context.stroke();
  context.fillStyle = colours.soft;
  context.textAlign = "right";
  context.fillText("N ↑", width - 6, 10);
  context.textAlign = "left";
  context.fillText(`grid ${step} m`, 6, height - 8);
}

function arrow(context, x, y, row, colours) {
  context.save();
  context.translate(x, y);
  context.fillStyle = colours.orange;
  context.beginPath();
  if (row?.status === "fixed" && row.heading_deg !== null) {
    context.rotate((row.heading_deg * Math.PI) / 180);
    context.moveTo(0, -12);
    context.lineTo(7, 9);
    context.lineTo(0, 4);
    context.lineTo(-7, 9);
  } else {
    context.arc(0, 0, 5, 0, 2 * Math.PI);
  }
  context.fill();
  context.restore();
}
