// The rows of the last ten minutes, thinned as the service thins them, and the newest one whole.

const WEEK_S = 604800;
// Behind the time: where heading, pitch, roll and their standard deviations are in a point.
export const HEADING = 1, PITCH = 3, ROLL = 5, LATITUDE = 7, LONGITUDE = 8;

export class Rows {
  constructor() {
    this.points = [];
    this.spanS = 600;
    this.stepS = 0.5;
    this.newest = null;
    this.cameAt = 0;
  }

  replace({ span_s, step_s, points }) {
    [this.spanS, this.stepS, this.points] = [span_s, step_s, points];
  }

  // Takes a row: the last one of its step counts, but one without heading stays.
  push(row) {
    this.newest = row;
    this.cameAt = performance.now();
    const isFixed = row.status === "fixed";
    const angle = (value) => (isFixed ? value : null);
    const timeS = Math.round((row.gps_week * WEEK_S + row.tow_s) * 1000) / 1000;
    const point = [
      timeS, angle(row.heading_deg), angle(row.heading_sd_deg), angle(row.pitch_deg), angle(row.pitch_sd_deg),
      angle(row.roll_deg), angle(row.roll_sd_deg), row.latitude_deg, row.longitude_deg,
    ];
    const last = this.points.at(-1);
    if (last && timeS <= last[0]) {
      if (timeS < last[0] - this.spanS) this.points = [point]; // another recording
      return;
    }
    const step = (of) => Math.floor(of[0] / this.stepS);
    if (last && step(last) === step(point)) {
      if (hasAngle(last)) this.points[this.points.length - 1] = point;
    } else {
      this.points.push(point);
    }
    let old = 0;
    while (this.points[old][0] < timeS - this.spanS) old += 1;
    if (old > 0) this.points.splice(0, old);
  }
}

export const hasAngle = (point) => point[HEADING] !== null || point[PITCH] !== null || point[ROLL] !== null;
