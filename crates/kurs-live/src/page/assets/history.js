// Heading, pitch and roll of the last ten minutes, with the band of one standard deviation and with gaps.

import { Surface, niceStep } from "./canvas.js";
import { HEADING, PITCH, ROLL, hasAngle } from "./rows.js";
import { byId } from "./words.js";

// Times between points that are longer than so many steps are gaps.
const GAP_STEPS = 2.5;
const LEFT = 48, RIGHT = 8, TOP = 8, BOTTOM = 18;
// Charts are drawn again so often, ms: a point is half a second.
const REDRAW_MS = 500;

export class History {
  constructor(rows) {
    this.rows = rows;
    const chart = (id, value, colour, name) =>
      new Surface(byId(id), (...surface) => draw(rows, value, colour, name, ...surface));
    this.charts = [
      chart("history-heading", HEADING, "blue", "heading"),
      chart("history-pitch", PITCH, "orange", "pitch"),
      chart("history-roll", ROLL, "green", "roll"),
    ];
    this.drawnAt = 0;
  }

  update() {
    const now = performance.now();
    if (now - this.drawnAt < REDRAW_MS) return;
    this.drawnAt = now;
    this.charts.forEach((chart) => chart.ask());
  }
}

// Parts without a gap, as [time, value, sd]; headings go on over 360° and come back.
export function parts(points, value, gapS) {
  const found = [];
  let turns = 0;
  let before = null;
  let lastTime = -Infinity;
  for (const point of points) {
    const [time, angle, sd] = [point[0], point[value], point[value + 1]];
    if (angle === null) {
      lastTime = -Infinity;
      continue;
    }
    if (value === HEADING && before !== null) turns -= 360 * Math.round((angle + turns - before) / 360);
    before = angle + turns;
    if (time - lastTime > gapS) found.push([]);
    found.at(-1).push([time, before, sd]);
    lastTime = time;
  }
  return found;
}

function draw(rows, value, colour, name, context, width, height, colours) {
  const { points, spanS, stepS } = rows;
  const lines = parts(points, value, GAP_STEPS * stepS);
  const end = points.at(-1)?.[0] ?? 0;
  const x = (time) => LEFT + ((time - end) / spanS + 1) * (width - LEFT - RIGHT);
  const [low, high] = range(lines);
  const y = (angle) => TOP + ((high - angle) / (high - low)) * (height - TOP - BOTTOM);

  grid(context, width, height, colours, low, high, y, value === HEADING, spanS);
  gaps(context, height, colours, points, stepS, x);
  context.fillStyle = context.strokeStyle = colours[colour];
  for (const line of lines) {
    context.globalAlpha = 0.25;
    context.beginPath();
    for (const [time, angle, sd] of line) context.lineTo(x(time), y(angle + sd));
    for (let k = line.length - 1; k >= 0; k -= 1) context.lineTo(x(line[k][0]), y(line[k][1] - line[k][2]));
    context.fill();
    context.globalAlpha = 1;
    context.lineWidth = 1.5;
    context.beginPath();
    for (const [time, angle] of line) context.lineTo(x(time), y(angle));
    if (line.length === 1) context.lineTo(x(line[0][0]) + 1, y(line[0][1]));
    context.stroke();
  }
  const text = lines.length > 0 ? name : `${name}: none`;
  context.fillStyle = colours.panel;
  context.fillRect(LEFT + 3, TOP, context.measureText(text).width + 6, 16);
  context.fillStyle = colours.soft;
  context.textAlign = "left";
  context.fillText(text, LEFT + 6, TOP + 8);
}

function range(lines) {
  let [low, high] = [Infinity, -Infinity];
  for (const line of lines) {
    for (const [, angle, sd] of line) {
      low = Math.min(low, angle - sd);
      high = Math.max(high, angle + sd);
    }
  }
  if (low > high) return [-1, 1];
  const more = Math.max(0.1 * (high - low), 0.25);
  return [low - more, high + more];
}

function grid(context, width, height, colours, low, high, y, isHeading, spanS) {
  const step = niceStep(high - low, 5);
  const places = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
  context.strokeStyle = colours.line;
  context.fillStyle = colours.soft;
  context.textAlign = "right";
  context.beginPath();
  for (let mark = Math.ceil(low / step) * step; mark <= high; mark += step) {
    context.moveTo(LEFT, Math.round(y(mark)) + 0.5);
    context.lineTo(width - RIGHT, Math.round(y(mark)) + 0.5);
    const angle = isHeading ? ((mark % 360) + 360) % 360 : mark;
    context.fillText(`${(Math.abs(angle) < 1e-9 ? 0 : angle).toFixed(places)}°`, LEFT - 6, y(mark));
  }
  context.textAlign = "center";
  for (let minute = 0; minute <= spanS / 60; minute += 2) {
    const x = width - RIGHT - (minute * 60 / spanS) * (width - LEFT - RIGHT);
    context.moveTo(Math.round(x) + 0.5, TOP);
    context.lineTo(Math.round(x) + 0.5, height - BOTTOM);
    context.textAlign = minute === 0 ? "right" : "center";
    context.fillText(minute === 0 ? "now" : `−${minute} min`, x, height - BOTTOM / 2);
  }
  context.stroke();
}

// Where there is no heading, however short: a stripe at the foot.
function gaps(context, height, colours, points, stepS, x) {
  context.fillStyle = colours.red;
  let from = null;
  const stripe = (to) => {
    if (from !== null) context.fillRect(x(from), height - BOTTOM - 5, Math.max(1.5, x(to) - x(from)), 5);
    from = null;
  };
  points.forEach((point, k) => {
    const before = points[k - 1];
    if (before && from === null && point[0] - before[0] > GAP_STEPS * stepS) from = before[0];
    if (hasAngle(point)) stripe(point[0]);
    else from ??= point[0];
  });
  if (points.length > 0) stripe(points.at(-1)[0] + stepS);
}
