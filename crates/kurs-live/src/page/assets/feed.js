// The feed of the service: server-sent events by fetch, which can show a token; made again for ever.

// The state comes every second: a connection that is silent for so long is dead.
const SILENCE_MS = 5000;
const PAUSES_MS = [500, 1000, 2000, 4000];

// Calls `take(name, data)` for every message and `tell(state)` with "open", "closed" or "refused".
export async function follow(token, take, tell) {
  for (let failures = 0; ; failures += 1) {
    const connection = new AbortController();
    try {
      const shown = token();
      const headers = shown ? { Authorization: `Bearer ${shown}` } : {};
      const response = await fetch("/feed", { headers, signal: connection.signal });
      if (response.ok) {
        tell("open");
        await read(response.body, connection, (name, data) => {
          failures = 0;
          take(name, data);
        });
      }
      tell(response.status === 401 ? "refused" : "closed");
    } catch {
      tell("closed");
    }
    const pause = PAUSES_MS[Math.min(failures, PAUSES_MS.length - 1)];
    await new Promise((resolve) => setTimeout(resolve, pause));
  }
}

async function read(body, connection, take) {
  const reader = body.pipeThrough(new TextDecoderStream()).getReader();
  let text = "";
  for (;;) {
    const silence = setTimeout(() => connection.abort(), SILENCE_MS);
    const { value, done } = await reader.read().finally(() => clearTimeout(silence));
    if (done) return;
    const messages = (text + value).split("\n\n");
    text = messages.pop();
    messages.forEach((message) => takeOne(message, take));
  }
}

function takeOne(message, take) {
  const field = (name) => message.split("\n").find((of) => of.startsWith(`${name}:`))?.slice(name.length + 1).trim();
  const [name, data] = [field("event"), field("data")];
  if (name && data) take(name, JSON.parse(data));
}
