// Every page from file://: no request to a network, no error on the console, every plot drawn, nothing
// wider than the screen, on paper too; at most 8 MB. Prints how long each takes to open, until what is on
// the screen is drawn, and until all is. It is to open in 3 seconds on an idle desktop; a page that takes
// three times as long on a busy one is at fault.
//
//   node check.mjs FOLDER PAGE...        screenshots go to FOLDER
import { statSync } from "node:fs";
import { execFileSync } from "node:child_process";
import { basename, dirname, join } from "node:path";
import { pathToFileURL } from "node:url";
import { chromium } from "playwright-core";

const MOST_BYTES = 8e6;
const MOST_SECONDS = 9;
const SCREENS = [
  { name: "desktop", width: 1280, height: 900 },
  { name: "phone", width: 400, height: 844, isMobile: true, deviceScaleFactor: 2, hasTouch: true },
];

const [folder, ...pages] = process.argv.slice(2);
const executablePath = execFileSync("which", ["chromium"]).toString().trim();
const browser = await chromium.launch({ executablePath, args: ["--no-sandbox"] });
const faults = [];

// What is in each plot: marks drawn, and the height of the drawing.
const drawn = () =>
  [...document.querySelectorAll("div.plot")].map((plot) => ({
    top: plot.getBoundingClientRect().top,
    height: plot.querySelector("svg.main-svg")?.getBoundingClientRect().height ?? 0,
    marks: plot.querySelectorAll(".scatterlayer path, .barlayer path").length,
  }));

// A part of the time that is chosen in one plot is shown by all plots over time.
const checkLinkedZoom = async (page, fault) => {
  const ranges = await page.evaluate(async () => {
    const timed = [...document.querySelectorAll("div.plot.time")];
    if (timed.length < 2) return [];
    const [first, last] = timed[0].layout.xaxis.range.map((end) => +new Date(end));
    const shown = () => timed.map((plot) => plot.layout.xaxis.range.map((end) => +new Date(end)).join());
    const settle = () => new Promise((resolve) => setTimeout(resolve, 500));
    await Plotly.relayout(timed[0], { "xaxis.range": [first + (last - first) / 4, last - (last - first) / 4] });
    await settle();
    const zoomed = shown();
    await Plotly.relayout(timed[0], { "xaxis.autorange": true });
    await settle();
    return [zoomed, shown().slice(1)].map((ends) => new Set(ends).size);
  });
  if (ranges.some((different) => different !== 1)) fault(`zoom is not linked: ${ranges}`);
};

for (const path of pages) {
  const name = `${basename(dirname(path))}-${basename(path, ".html")}`;
  const bytes = statSync(path).size;
  if (bytes > MOST_BYTES) faults.push(`${name}: ${bytes} bytes`);
  for (const { name: screen, width, height, ...device } of SCREENS) {
    const context = await browser.newContext({ viewport: { width, height }, ...device });
    const page = await context.newPage();
    const fault = (text) => faults.push(`${name}, ${screen}: ${text}`);
    page.on("console", (message) => message.type() === "error" && fault(`console: ${message.text()}`));
    page.on("pageerror", (error) => fault(`error: ${error.message}`));
    page.on("request", (request) => {
      if (!/^(file|data|blob):/.test(request.url())) fault(`request to ${request.url()}`);
    });
    const start = performance.now();
    await page.goto(pathToFileURL(path).href, { waitUntil: "load" });
    const until = async (plots, what) => {
      const isDrawn = `(${drawn})().filter(${plots}).every((plot) => plot.marks > 0)`;
      await page.waitForFunction(isDrawn, null, { timeout: 30_000 }).catch(() => fault(`not drawn: ${what}`));
      return (performance.now() - start) / 1000;
    };
    const seconds = await until("(plot) => plot.top < window.innerHeight", "what is on the screen");
    const allSeconds = await until("() => true", "everything");
    if (screen === "desktop" && seconds > MOST_SECONDS) fault(`open after ${seconds.toFixed(1)} s`);

    const plots = await page.evaluate(drawn);
    plots.forEach((plot, k) => {
      if (plot.marks === 0 || plot.height < 100) fault(`plot ${k + 1} is empty`);
    });
    if (screen === "desktop") await checkLinkedZoom(page, fault);
    const overflow = await page.evaluate("document.documentElement.scrollWidth - window.innerWidth");
    if (overflow > 1) fault(`${overflow} px wider than the screen`);
    await page.screenshot({ path: join(folder, `${name}-${screen}.png`), fullPage: true });
    console.log(
      `${name}, ${screen}: ${plots.length} plots, ${(bytes / 1e6).toFixed(1)} MB, ` +
        `opened in ${seconds.toFixed(1)} s, all drawn in ${allSeconds.toFixed(1)} s`,
    );
    if (screen === "desktop") await page.pdf({ path: join(folder, `${name}.pdf`), format: "A4" });
    await context.close();
  }
}
await browser.close();
faults.forEach((fault) => console.error(`FAULT ${fault}`));
process.exit(faults.length > 0 ? 1 : 0);
