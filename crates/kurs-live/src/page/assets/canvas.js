// Drawing surfaces: as sharp as the screen, in the colours of the style, and never too much in one frame.

// Of the surfaces that are not urgent one is drawn in so long, ms: an update at 20 Hz.
const TURN_MS = 50;

const urgent = new Set();
const patient = new Set();
let isAsked = false;
let lastTurn = 0;
let colours = readColours();

function readColours() {
  const style = getComputedStyle(document.documentElement);
  const names = ["paper", "panel", "ink", "soft", "line", "blue", "orange", "green", "red", "sky", "ground"];
  return Object.fromEntries(names.map((name) => [name, style.getPropertyValue(`--${name}`).trim()]));
}

matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => {
  colours = readColours();
  surfaces.forEach((surface) => surface.ask());
});

const surfaces = [];

// A canvas with the function that draws it; `ask` has it drawn in the next frame, or when it is its turn.
export class Surface {
  constructor(canvas, draw, isUrgent = false) {
    this.canvas = canvas;
    this.queue = isUrgent ? urgent : patient;
    this.draw = draw;
    this.context = canvas.getContext("2d");
    this.width = 0;
    this.height = 0;
    surfaces.push(this);
    new ResizeObserver(([entry]) => this.resize(entry.contentRect)).observe(canvas);
  }

  resize({ width, height }) {
    const scale = devicePixelRatio || 1;
    [this.width, this.height] = [width, height];
    this.canvas.width = Math.round(width * scale);
    this.canvas.height = Math.round(height * scale);
    this.context.setTransform(scale, 0, 0, scale, 0, 0);
    this.ask();
  }

  ask() {
    this.queue.add(this);
    if (!isAsked) {
      isAsked = true;
      requestAnimationFrame(drawSome);
    }
  }

  paint() {
    if (this.width === 0 || this.height === 0) return;
    this.context.clearRect(0, 0, this.width, this.height);
    this.context.lineWidth = 1;
    this.context.font = "12px system-ui, sans-serif";
    this.context.textBaseline = "middle";
    this.context.textAlign = "center";
    this.draw(this.context, this.width, this.height, colours);
  }
}

function drawSome(now) {
  urgent.forEach((surface) => surface.paint());
  urgent.clear();
  const [next] = patient;
  if (next && now - lastTurn >= TURN_MS) {
    lastTurn = now;
    patient.delete(next);
    next.paint();
  }
  isAsked = patient.size > 0;
  if (isAsked) requestAnimationFrame(drawSome);
}

// The step of 1, 2 or 5 times a power of ten that divides a range into at most so many parts.
export function niceStep(range, parts) {
  const power = 10 ** Math.floor(Math.log10(range / parts));
  return power * [1, 2, 5, 10].find((factor) => (power * factor * parts) >= range * (1 - 1e-9));
}
