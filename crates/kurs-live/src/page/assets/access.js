// The token, kept as long as the tab, and what can be done with it.

import { byId, write } from "./words.js";

const KEY = "kurs-token";

export const token = () => sessionStorage.getItem(KEY) ?? "";

export function begin() {
  byId("token-form").addEventListener("submit", (event) => {
    event.preventDefault();
    sessionStorage.setItem(KEY, byId("token").value.trim());
    byId("token").value = "";
    enable();
  });
  byId("mark-form").addEventListener("submit", async (event) => {
    event.preventDefault();
    const response = await ask("POST", "/api/mark", byId("mark").value);
    if (response?.ok) byId("mark").value = "";
  });
  enable();
}

// Whether the service takes changes, or wants the token for everything.
export function show(isWanted) {
  byId("access").hidden = !isWanted;
  document.body.classList.toggle("changes", isWanted);
}

export async function act(name, what) {
  const path = `/api/streams/${encodeURIComponent(name)}/${what}`;
  if (what === "restart") return ask("POST", path);
  const response = await ask("GET", path);
  if (response?.ok) await save(response);
}

async function ask(method, path, body) {
  const headers = { Authorization: `Bearer ${token()}` };
  try {
    const response = await fetch(path, { method, headers, body });
    const isText = response.headers.get("content-type")?.startsWith("text/");
    write(byId("answer"), isText ? (await response.text()).trim() : "saving the log");
    return response;
  } catch {
    write(byId("answer"), "no connection to the service");
    return null;
  }
}

async function save(response) {
  const name = /filename="([^"]+)"/.exec(response.headers.get("content-disposition") ?? "")?.[1] ?? "kurs.raw";
  const link = document.createElement("a");
  link.href = URL.createObjectURL(await response.blob());
  link.download = name;
  link.click();
  URL.revokeObjectURL(link.href);
  write(byId("answer"), `saved as ${name}`);
}

function enable() {
  const hasToken = token() !== "";
  byId("mark-form").querySelector("button").disabled = !hasToken;
  write(byId("answer"), hasToken ? "A token is set in this tab." : "");
}
