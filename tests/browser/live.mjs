// The page of a running service, on simulated receivers with 20 Hz: its values are those of the stream, it survives
// a reload and a restart of the service, asks nothing of others, tells no error, changes nothing without the token;
// and how much of the browser's time it takes.
//
//   node live.mjs FOLDER KURS [SECONDS [SLACK]]     SECONDS of measurement (default 5), SLACK times the bounds of time
//                                                   (default 1); screenshots go to FOLDER
//
// Script and layout (with style and paint) are summed over 50 ms, which is one update at 20 Hz, in processor time of
// the page's main thread, so that other programs on the machine do not count.
import { execFileSync, spawn } from "node:child_process";
import { mkdirSync, writeFileSync } from "node:fs";
import net from "node:net";
import { join } from "node:path";
import { setTimeout as sleep } from "node:timers/promises";
import { chromium } from "playwright-core";

const MOST_UPDATE_MS = 8;
const MOST_TASK_MS = 50;
const MOST_GROWTH_BYTES = 2e6;
const UPDATE_MS = 50;
const TOKEN = "a token of the test";
const TOKEN_SHOWN = TOKEN.replaceAll(" ", "-");

const [folder, kurs, seconds = "5", slack = "1"] = process.argv.slice(2);
mkdirSync(folder, { recursive: true });
const faults = [];
const fault = (text) => faults.push(text);

// Ports that are free now: four of receivers in a row, one of lines, one of the page.
const freePort = () => new Promise((resolve) => {
  const server = net.createServer().listen(0, "127.0.0.1", () => {
    const { port } = server.address();
    server.close(() => resolve(port));
  });
});
const [streams, lines, page] = [await freePort(), await freePort(), await freePort()];
const at = `http://127.0.0.1:${page}`;

const antenna = (name, port, place) => `[[antenna]]\nname = "${name}"\nstream = "tcp://127.0.0.1:${port}"\nposition_m = ${place}\n`;
writeFileSync(join(folder, "token"), `${TOKEN_SHOWN}\n`);
writeFileSync(join(folder, "live.toml"), `
${antenna("A0", streams, "[0.0, 0.0, 0.0]")}${antenna("A1", streams + 1, "[1.5, 0.0, 0.0]")}
${antenna("A2", streams + 2, "[0.0, 0.8, 0.0]")}
[live]
body = "ferry"
page = "127.0.0.1:${page}"
token_file = "token"
state_dir = "state"
[log]
dir = "logs"
[[output]]
to = "tcp-listen://127.0.0.1:${lines}"
profile = "jsonl"
`);
const children = [];
const run = (...args) => {
  const child = spawn(kurs, args, { stdio: ["ignore", "ignore", "inherit"] });
  children.push(child);
  return child;
};
const end = () => children.forEach((child) => child.kill("SIGKILL"));
process.on("exit", end);
["SIGINT", "SIGTERM"].forEach((name) => process.on(name, () => process.exit(1)));
const startService = () => run("live", join(folder, "live.toml"), "--out", join(folder, "live"), "--quiet");

run("simulate", "live.toml", "--stream", String(streams), "--quiet");
let service = startService();

// The rows of the output, by time.
const sent = new Map();
const listen = () => {
  let text = "";
  const socket = net.connect(lines, "127.0.0.1");
  socket.on("data", (data) => {
    const parts = (text + data).split("\n");
    text = parts.pop();
    parts.map((part) => JSON.parse(part)).forEach((row) => sent.set(row.time_gpst, row));
  });
  socket.on("error", () => {});
  socket.on("close", () => setTimeout(listen, 100));
};
listen();

const executablePath = execFileSync("which", ["chromium"]).toString().trim();
const browser = await chromium.launch({ executablePath, args: ["--no-sandbox"] });
const isOurs = (url) => url.startsWith(`${at}/`) || url.startsWith("data:") || url.startsWith("blob:");

async function open(options) {
  const context = await browser.newContext(options);
  const tab = await context.newPage();
  let isServed = true;
  tab.on("console", (message) => {
    if (message.type() === "error" && isServed) fault(`console: ${message.text()}`);
  });
  tab.on("pageerror", (error) => fault(`error: ${error.message}`));
  tab.on("request", (request) => isOurs(request.url()) || fault(`request to ${request.url()}`));
  await tab.goto(at);
  return { context, tab, serve: (is) => { isServed = is; } };
}

const text = (tab, id) => tab.locator(`#${id}`).textContent();
const isGood = (tab) => tab.waitForFunction(() => document.getElementById("verdict").className === "good", null, { timeout: 60_000 });

async function until(what, check) {
  for (let tries = 0; tries < 600; tries += 1) {
    if (await check()) return;
    await sleep(100);
  }
  throw new Error(`${what} does not come`);
}

// What is shown at one instant is one row of the stream.
async function checkValues(tab, count) {
  const ids = ["time", "heading", "heading-sd", "pitch", "pitch-sd", "roll", "roll-sd", "status", "satellites"];
  const shown = [];
  for (let k = 0; k < count; k += 1) {
    shown.push(await tab.evaluate((ids) => ids.map((id) => document.getElementById(id).textContent), ids));
    await sleep(100);
  }
  await sleep(500);
  let [compared, fixed] = [0, 0];
  for (const [time, ...values] of shown) {
    const row = sent.get(time);
    if (!row) continue;
    compared += 1;
    const number = (value, unit) => (value === null ? "–" : `${value.toFixed(2)}${unit}`);
    const sd = (value) => (value === null ? "" : `±${value.toFixed(2)}`);
    const angles = ["heading", "pitch", "roll"].flatMap((name) => [number(row[`${name}_deg`], "°"), sd(row[`${name}_sd_deg`])]);
    const wanted = [...angles, row.status, String(row.satellites)];
    fixed += row.status === "fixed";
    if (wanted.join() !== values.join()) fault(`shown at ${time}: ${values}, sent: ${wanted}`);
  }
  if (compared < count * 0.8 || fixed < compared / 2) fault(`${compared} of ${count} shown rows were sent, ${fixed} fixed`);
  return compared;
}

await until("the page", () => fetch(at).then((answer) => answer.ok, () => false));
const desktop = await open({ viewport: { width: 1280, height: 900 } });
await isGood(desktop.tab);
console.log(`${await checkValues(desktop.tab, 20)} rows shown as they were sent`);

// A reload has the history of before.
const points = () => desktop.tab.evaluate(() => document.querySelector("#events-list").children.length);
const eventsBefore = await points();
await desktop.tab.reload();
await isGood(desktop.tab);
if ((await points()) < eventsBefore) fault("events are gone after a reload");

// The token, through the page: without it nothing changes, with it a mark is an event.
const post = (headers) => fetch(`${at}/api/mark`, { method: "POST", body: "not to be seen", headers }).then((answer) => answer.status);
const refusals = [await post({}), await post({ Authorization: "Bearer wrong-wrong-wrong" }), await post({ Authorization: `Bearer ${TOKEN_SHOWN}`, Origin: "http://elsewhere.example" })];
if (refusals.join() !== "401,401,403") fault(`changes without the token: ${refusals}`);
await desktop.tab.fill("#token", TOKEN_SHOWN);
await desktop.tab.press("#token", "Enter");
await desktop.tab.fill("#mark", "anchor up");
await desktop.tab.press("#mark", "Enter");
await desktop.tab.locator("#events-list li", { hasText: "mark: anchor up" }).waitFor({ timeout: 10_000 });
if ((await text(desktop.tab, "events-list")).includes("not to be seen")) fault("a mark without the token is an event");
const [download] = await Promise.all([
  desktop.tab.waitForEvent("download"),
  desktop.tab.getByRole("button", { name: "Save log A0" }).click(),
]);
if (!/^A0-\d{8}T\d{6}Z\.raw$/.test(download.suggestedFilename())) fault(`log ${download.suggestedFilename()}`);

// How much time it takes.
const session = await desktop.context.newCDPSession(desktop.tab);
const heap = async () => {
  await session.send("HeapProfiler.collectGarbage");
  return (await session.send("Runtime.getHeapUsage")).usedSize;
};
await sleep(2000);
const heapBefore = await heap();
const trace = [];
session.on("Tracing.dataCollected", ({ value }) => trace.push(...value));
await session.send("Tracing.start", {
  transferMode: "ReportEvents",
  traceConfig: { recordMode: "recordContinuously", includedCategories: ["devtools.timeline", "toplevel", "disabled-by-default-devtools.timeline"], excludedCategories: ["*"] },
});
await sleep(Number(seconds) * 1000);
const traced = new Promise((resolve) => session.once("Tracing.tracingComplete", resolve));
await session.send("Tracing.end");
await traced;
const growth = (await heap()) - heapBefore;
judgeTrace(trace, growth);

function judgeTrace(events, growth) {
  const work = new Set(["FunctionCall", "EvaluateScript", "RunMicrotasks", "FireAnimationFrame", "TimerFire", "UpdateLayoutTree", "Layout", "PrePaint", "Paint", "Layerize", "Commit", "MinorGC", "MajorGC", "V8.GCScavenger", "XHRReadyStateChange"]);
  const threads = new Map();
  for (const event of events) {
    if (event.ph !== "X" || !event.dur) continue;
    const key = `${event.pid}/${event.tid}`;
    if (!threads.has(key)) threads.set(key, []);
    threads.get(key).push(event);
  }
  const scripts = (list) => list.filter((event) => event.name === "FunctionCall" || event.name === "RunMicrotasks").length;
  const main = [...threads.values()].sort((a, b) => scripts(b) - scripts(a))[0] ?? [];
  main.sort((a, b) => a.ts - b.ts || b.dur - a.dur);
  const cpu = (event) => (event.tdur ?? event.dur) / 1000;
  const bins = new Map();
  let end = -Infinity;
  for (const event of main.filter((event) => work.has(event.name))) {
    if (event.ts < end) continue; // within another one
    end = event.ts + event.dur;
    const bin = Math.floor(event.ts / 1000 / UPDATE_MS);
    bins.set(bin, (bins.get(bin) ?? 0) + cpu(event));
  }
  const sums = [...bins.values()].sort((a, b) => a - b);
  const quantile = (share) => sums[Math.max(Math.ceil(share * sums.length), 1) - 1] ?? NaN; // by rank
  const tasks = main.filter((event) => /RunTask$/.test(event.name)).map(cpu);
  const longest = tasks.reduce((most, task) => Math.max(most, task), 0);
  console.log(
    `${seconds} s, ${sums.length} updates: script and layout of an update median ${quantile(0.5).toFixed(1)}, ` +
      `p99 ${quantile(0.99).toFixed(1)}, longest ${quantile(1).toFixed(1)} ms; longest of ${tasks.length} tasks ` +
      `${longest.toFixed(1)} ms; heap ${(growth / 1e6).toFixed(2)} MB more`,
  );
  if (!(sums.length > seconds * 10)) fault(`only ${sums.length} updates in the trace`);
  if (!(quantile(0.99) <= slack * MOST_UPDATE_MS)) fault(`an update takes ${quantile(0.99)} ms (p99)`);
  if (!(longest <= slack * MOST_TASK_MS)) fault(`a task of ${longest} ms`);
  if (growth > MOST_GROWTH_BYTES) fault(`the heap grows by ${growth} bytes`);
}

// The service stops and starts again: the page says so, and goes on by itself.
desktop.serve(false);
service.kill("SIGTERM");
await desktop.tab.waitForFunction(() => document.getElementById("verdict-text").textContent.startsWith("No connection"), null, { timeout: 20_000 });
service = startService();
await isGood(desktop.tab);
desktop.serve(true);
sent.clear();
await checkValues(desktop.tab, 10);

// Pictures to be looked at; nothing is wider than the screen.
for (const colorScheme of ["light", "dark"]) {
  for (const [name, width, height] of [["desktop", 1280, 900], ["phone", 400, 844]]) {
    const device = name === "phone" ? { isMobile: true, hasTouch: true, deviceScaleFactor: 2 } : {};
    const { context, tab } = await open({ viewport: { width, height }, colorScheme, ...device });
    await isGood(tab);
    await sleep(1500);
    const overflow = await tab.evaluate("document.documentElement.scrollWidth - window.innerWidth");
    if (overflow > 1) fault(`${name}: ${overflow} px wider than the screen`);
    const table = await tab.evaluate("(({ scrollWidth, clientWidth }) => scrollWidth - clientWidth)(document.querySelector('#streams .scroll'))");
    if (table > 1) fault(`${name}: the table of streams is ${table} px wider than its place`);
    await tab.screenshot({ path: join(folder, `live-${name}-${colorScheme}.png`), fullPage: true });
    await context.close();
  }
}
await browser.close();
faults.forEach((text) => console.error(`FAULT ${text}`));
process.exit(faults.length > 0 ? 1 : 0);
