// Drawing surfaces: as sharp as the screen, in the colours of the style, and never too much in one frame.

// So long, in ms, drawing may take in a frame before the rest waits for the next one.
const BUDGET_MS = 4;

const waiting = new Map();
let isAsked = false;
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

// A canvas with the function that draws it; `ask` has it drawn in one of the next frames.
export class Surface {
  constructor(canvas, draw) {
    this.canvas = canvas;
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
    waiting.set(this, true);
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

function drawSome() {
  const start = performance.now();
  for (const surface of waiting.keys()) {
    waiting.delete(surface);
    surface.paint();
    if (performance.now() - start > BUDGET_MS) break;
  }
  isAsked = waiting.size > 0;
  if (isAsked) requestAnimationFrame(drawSome);
}

// The step of 1, 2 or 5 times a power of ten that divides a range into at most so many parts.
export function niceStep(range, parts) {
  const power = 10 ** Math.floor(Math.log10(range / parts));
  return power * [1, 2, 5, 10].find((factor) => (power * factor * parts) >= range * (1 - 1e-9));
}

export function line(context, points, colour) {
  context.strokeStyle = colour;
  context.beginPath();
  for (const [x, y] of points) context.lineTo(x, y);
  context.stroke();
}
