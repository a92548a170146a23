// What @canboat/canboatjs and @signalk/nmea0183-signalk make of captured outputs, and whether deltas are valid:
//
//   node read.mjs FOLDER        a JSON object to standard output
//
// FOLDER holds what came by every output, in a file with the profile's name.
import fs from "node:fs";
import { createRequire } from "node:module";

const require = createRequire(import.meta.url);
const { FromPgn } = require("@canboat/canboatjs");
const { Parser } = require("@signalk/nmea0183-signalk");
const { validateDelta } = require("@signalk/signalk-schema");
const folder = process.argv[2];
const lines = (name) => fs.readFileSync(`${folder}/${name}`, "utf8").split("\n").map((l) => l.trim()).filter(Boolean);

// Messages of NMEA 2000: number and fields.
function pgns(name) {
  const found = [];
  const reader = new FromPgn({ returnNulls: true });
  reader.on("error", (pgn, error) => found.push({ error: `${error}` }));
  for (const line of lines(name)) {
    const pgn = reader.parseString(line);
    if (pgn) found.push({ pgn: pgn.pgn, src: pgn.src, prio: pgn.prio, fields: pgn.fields });
  }
  return found;
}

// Every value that the sentences of an epoch (each begins with GGA) become.
function sentences(name) {
  const epochs = [];
  const parser = new Parser();
  for (const line of lines(name)) {
    if (line.includes("GGA,")) epochs.push({});
    const delta = parser.parse(line);
    for (const update of delta?.updates ?? []) {
      for (const { path, value } of update.values) epochs.at(-1)[path] = value;
    }
  }
  return epochs;
}

const deltas = lines("signalk").map((line) => {
  const delta = JSON.parse(line);
  return { delta, errors: validateDelta(delta).errors ?? [] };
});
const result = { marine: sentences("marine"), deltas };
for (const name of ["nmea2000", "nmea2000-bus", "nmea2000-canboat"]) result[name] = pgns(name);
process.stdout.write(JSON.stringify(result));
