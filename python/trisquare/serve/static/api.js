// Requests to the page's own server, relative to the page's address: a proxy may add a path.

const token = new URLSearchParams(location.search).get("token") ?? "";
let mostBytes = Infinity;

/** An error from the server: its code, its text, and the targets found and rejected. */
export class Refusal extends Error {
  constructor({ code, text, found = [], rejected = [] }) {
    super(text);
    Object.assign(this, { code, found, rejected });
  }
}

async function sent(path, init) {
  let answer;
  try {
    answer = await fetch(path, { ...init, headers: { ...init.headers, "X-Trisquare-Token": token } });
  } catch (error) {
    if (error.name === "AbortError") throw error;
    throw new Refusal({ code: "NetworkError", text: "The server does not answer, or refuses so much data." });
  }
  if (!answer.ok) {
    const told = await answer.json().catch(() => null);
    throw new Refusal(told?.error ?? { code: "ServerError", text: `The server answers ${answer.status}.` });
  }
  return answer;
}

export async function status() {
  const told = await (await sent("api/status", {})).json();
  mostBytes = told.max_bytes;
  return told;
}

function form(files, options) {
  const bytes = files.reduce((sum, [, file]) => sum + file.size, 0);
  if (bytes > mostBytes) {
    const [size, most] = [bytes, mostBytes].map((own) => `${(own / 1e6).toPrecision(3)} MB`);
    throw new Refusal({ code: "TooLargeError", text: `${size} are more than the ${most} that can be sent at a time.` });
  }
  const body = new FormData();
  for (const [field, file, name] of files) body.append(field, file, name);
  body.append("options", JSON.stringify(options));
  return body;
}

/** Posts files, each [field, Blob, name], and options; returns JSON. */
export async function ask(route, files, options = {}, signal = undefined) {
  return (await sent(`api/${route}`, { method: "POST", body: form(files, options), signal })).json();
}

/** Posts files and options; returns the file in the answer, {blob, name}. */
export async function askFile(route, files, options = {}) {
  const answer = await sent(`api/${route}`, { method: "POST", body: form(files, options) });
  const name = /filename="([^"]*)"/.exec(answer.headers.get("Content-Disposition") ?? "")?.[1];
  return { blob: await answer.blob(), name: name ?? route };
}

/** Posts files and options; returns an array of the files in the answer. */
export async function askFiles(route, files, options = {}) {
  const answer = await sent(`api/${route}`, { method: "POST", body: form(files, options) });
  return (await answer.formData()).getAll("picture");
}

/** Posts JSON; returns JSON. */
export async function askJson(route, members, signal = undefined) {
  const headers = { "Content-Type": "application/json" };
  const init = { method: "POST", body: JSON.stringify(members), headers, signal };
  return (await sent(`api/${route}`, init)).json();
}

/** Lets the browser save a file. */
export function save(blob, name) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(blob);
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
}

export function jsonBlob(members) {
  return new Blob([JSON.stringify(members)], { type: "application/json" });
}
