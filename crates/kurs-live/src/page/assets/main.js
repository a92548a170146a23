// The page put together: messages of the feed go to the rows and to what shows them.

import * as access from "./access.js";
import { AntennaArray } from "./array.js";
import { Events } from "./events.js";
import { follow } from "./feed.js";
import { History } from "./history.js";
import { Instruments } from "./instruments.js";
import * as peers from "./peers.js";
import { Rows } from "./rows.js";
import { Sky } from "./sky.js";
import { Streams } from "./streams.js";
import { Track } from "./track.js";
import * as verdict from "./verdict.js";
import { byId, write } from "./words.js";

// Descriptions for screen readers change so often, ms.
const DESCRIBE_MS = 5000;

const rows = new Rows();
const instruments = new Instruments(rows);
const history = new History(rows);
const track = new Track(rows);
const sky = new Sky();
const array = new AntennaArray();
const streams = new Streams(access.act);
const events = new Events();
let [link, state, body] = ["closed", null, "Kurs"];
let known = "";

const takers = {
  hello(hello) {
    body = hello.body;
    write(byId("body"), body);
    write(byId("version"), `Kurs ${hello.version}, running since ${new Date(hello.began_ms).toISOString().slice(0, 19)}Z.`);
    access.show(hello.has_token);
    streams.hasLog = hello.has_log;
    const antennas = JSON.stringify(hello.antennas);
    if (antennas === known) return;
    known = antennas;
    sky.setAntennas(hello.antennas.map(({ name }) => name));
    array.setAntennas(hello.antennas);
  },
  history(points) {
    rows.replace(points);
    history.update();
    track.update();
  },
  state(newest) {
    state = newest;
    sky.update(state.sky);
    array.update(state.array);
    streams.update(state);
    events.update(state.utc_ms);
    peers.show(state.relative);
    track.update();
    judge();
  },
  events(list) {
    events.replace(list, state?.utc_ms ?? Date.now());
  },
  row(row) {
    rows.push(row);
    array.push(row);
    instruments.update();
    history.update();
    judge();
  },
};

function judge() {
  verdict.show(link, state, rows.newest, (performance.now() - rows.cameAt) / 1000);
}

function title() {
  const row = rows.newest;
  const heading = row?.status === "fixed" && row.heading_deg !== null ? `${row.heading_deg.toFixed(0)}°` : "no heading";
  const text = `${link === "open" ? heading : "no connection"} – ${body}`;
  if (document.title !== text) document.title = text;
}

access.begin();
setInterval(() => { judge(); title(); }, 1000);
setInterval(() => rows.newest && instruments.describe(), DESCRIBE_MS);
follow(access.token, (name, data) => takers[name]?.(data), (now) => {
  link = now;
  if (now === "refused") access.show(true);
  judge();
});
