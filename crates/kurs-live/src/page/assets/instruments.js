// Heading tape, artificial horizon, and the numbers beside them: the newest row.

import { Surface } from "./canvas.js";
import { byId, write } from "./words.js";

const TAPE_DEG = 60; // over the whole width
const PITCH_DEG = 30; // from the middle of the horizon to its edge
const POINTS = { 0: "N", 45: "NE", 90: "E", 135: "SE", 180: "S", 225: "SW", 270: "W", 315: "NW" };

export class Instruments {
  constructor(rows) {
    this.rows = rows;
    this.tape = new Surface(byId("tape"), (...surface) => this.drawTape(...surface), true);
    this.horizon = new Surface(byId("horizon"), (...surface) => this.drawHorizon(...surface), true);
  }

  update() {
    const row = this.rows.newest;
    this.tape.ask();
    this.horizon.ask();
    const fixed = row.status === "fixed";
    number("heading", fixed ? row.heading_deg : null, row.heading_sd_deg);
    number("pitch", fixed ? row.pitch_deg : null, row.pitch_sd_deg);
    number("roll", fixed ? row.roll_deg : null, row.roll_sd_deg);
    number("turn", fixed ? row.heading_rate_degps : null, row.heading_rate_sd_degps, "°/s");
    number("course", row.course_deg, null);
    const has = row.vel_north_mps !== null;
    write(byId("speed"), has ? `${Math.hypot(row.vel_north_mps, row.vel_east_mps).toFixed(1)} m/s` : "");
    write(byId("satellites"), String(row.satellites ?? "–"));
    write(byId("status"), row.status);
    write(byId("time"), row.time_gpst);
    const place = row.latitude_deg === null ? "no position"
      : `${row.latitude_deg.toFixed(6)}°, ${row.longitude_deg.toFixed(6)}°, ${row.height_m.toFixed(1)} m`;
    write(byId("place"), place);
  }

  // What a screen reader finds in the pictures; not at every row.
  describe() {
    const row = this.rows.newest;
    const angle = (value) => (value === null ? "unknown" : `${value.toFixed(1)} degrees`);
    byId("tape").setAttribute("aria-label", `Heading ${angle(row.heading_deg)}`);
    byId("horizon").setAttribute("aria-label", `Pitch ${angle(row.pitch_deg)}, roll ${angle(row.roll_deg)}`);
  }

  drawTape(context, width, height, colours) {
    const row = this.rows.newest;
    const heading = row?.status === "fixed" ? row.heading_deg : null;
    const perDeg = width / TAPE_DEG;
    const base = height - 14;
    if (heading === null) return none(context, width, height, colours, "no heading");
    // The band of one standard deviation behind the pointer.
    const half = Math.max(1, row.heading_sd_deg * perDeg);
    context.fillStyle = colours.blue;
    context.globalAlpha = 0.2;
    context.fillRect(width / 2 - half, 14, 2 * half, base - 14);
    context.globalAlpha = 1;
    context.strokeStyle = context.fillStyle = colours.ink;
    context.beginPath();
    for (let mark = Math.ceil(heading - TAPE_DEG / 2); mark <= heading + TAPE_DEG / 2; mark += 1) {
      const x = width / 2 + (mark - heading) * perDeg;
      if (mark % 5 === 0) {
        context.moveTo(x, base - (mark % 10 === 0 ? 14 : 8));
        context.lineTo(x, base);
      }
      const label = ((mark % 360) + 360) % 360;
      if (POINTS[label]) context.fillText(POINTS[label], x, base - 36);
      if (mark % 10 === 0) context.fillText(String(label).padStart(3, "0"), x, base - 22);
    }
    context.moveTo(0, base);
    context.lineTo(width, base);
    context.stroke();
    context.fillStyle = colours.blue;
    context.beginPath();
    context.moveTo(width / 2, base - 2);
    context.lineTo(width / 2 - 8, height);
    context.lineTo(width / 2 + 8, height);
    context.fill();
    if (row.course_deg === null || Math.hypot(row.vel_north_mps, row.vel_east_mps) < 1) return;
    const off = ((row.course_deg - heading + 540) % 360) - 180;
    if (Math.abs(off) > TAPE_DEG / 2) return;
    const x = width / 2 + off * perDeg;
    context.strokeStyle = colours.orange;
    context.beginPath();
    context.arc(x, base + 6, 5, 0, 2 * Math.PI);
    context.stroke();
  }

  drawHorizon(context, width, height, colours) {
    const row = this.rows.newest;
    const isFixed = row?.status === "fixed";
    const [pitch, roll] = [isFixed ? row.pitch_deg : null, isFixed ? row.roll_deg : null];
    if (pitch === null && roll === null) return none(context, width, height, colours, "no pitch, no roll");
    const perDeg = height / 2 / PITCH_DEG;
    context.save();
    context.beginPath();
    context.rect(0, 0, width, height);
    context.clip();
    context.translate(width / 2, height / 2);
    context.rotate((-(roll ?? 0) * Math.PI) / 180);
    context.translate(0, (pitch ?? 0) * perDeg);
    const far = 2 * (width + height);
    context.fillStyle = colours.sky;
    context.fillRect(-far, -far, 2 * far, far);
    context.fillStyle = colours.ground;
    context.fillRect(-far, 0, 2 * far, far);
    context.strokeStyle = context.fillStyle = colours.ink;
    context.beginPath();
    context.moveTo(-far, 0);
    context.lineTo(far, 0);
    for (let mark = -80; mark <= 80; mark += 5) {
      const half = mark === 0 ? 0 : mark % 10 === 0 ? 32 : 16;
      context.moveTo(-half, -mark * perDeg);
      context.lineTo(half, -mark * perDeg);
      if (mark !== 0 && mark % 10 === 0) context.fillText(String(Math.abs(mark)), half + 14, -mark * perDeg);
    }
    context.stroke();
    context.restore();
    // The body: it stays, the world turns.
    context.strokeStyle = colours.orange;
    context.lineWidth = 4;
    context.beginPath();
    const [x, y] = [width / 2, height / 2];
    context.moveTo(x - 70, y);
    context.lineTo(x - 24, y);
    context.lineTo(x - 24, y + 8);
    context.moveTo(x + 70, y);
    context.lineTo(x + 24, y);
    context.lineTo(x + 24, y + 8);
    context.moveTo(x - 2, y);
    context.lineTo(x + 2, y);
    context.stroke();
    context.fillStyle = colours.ink;
    context.textAlign = "left";
    const unseen = pitch === null ? "pitch is not seen by this array" : roll === null ? "roll is not seen by this array" : "";
    context.fillText(unseen, 8, height - 10);
  }
}

function number(id, value, sd, unit = "°") {
  write(byId(id), value === null ? "–" : `${value.toFixed(2)}${unit}`);
  const element = byId(`${id}-sd`);
  if (element) write(element, value === null || sd === null ? "" : `±${sd.toFixed(2)}`);
}

function none(context, width, height, colours, text) {
  context.fillStyle = colours.soft;
  context.fillText(text, width / 2, height / 2);
}
