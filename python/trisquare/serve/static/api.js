// Requests to the server that this page came from, below its own address: a proxy may add a path.

const token = new URLSearchParams(location.search).get("token") ?? "";
let mostBytes = Infinity;

/** An error that the server states: its code, its text, and what was found before. */
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

/** Post files, each [field, Blob, name], and options; return JSON. */
export async function ask(route, files, options = {}, signal = undefined) {
  return (await sent(`api/${route}`, { method: "POST", body: form(files, options), signal })).json();
}

/** The same where the answer is a file: {blob, name}. */
export async function askFile(route, files, options = {}) {
  const answer = await sent(`api/${route}`, { method: "POST", body: form(files, options) });
  const name = /filename="([^"]*)"/.exec(answer.headers.get("Content-Disposition") ?? "")?.[1];
  return { blob: await answer.blob(), name: name ?? route };
}

/** The same where the answer is several files: an array of them. */
export async function askFiles(route, files, options = {}) {
  const answer = await sent(`api/${route}`, { method: "POST", body: form(files, options) });
  return (await answer.formData()).getAll("picture");
}

/** Post JSON; return JSON. */
export async function askJson(route, members, signal = undefined) {
  const headers = { "Content-Type": "application/json" };
  const init = { method: "POST", body: JSON.stringify(members), headers, signal };
  return (await sent(`api/${route}`, init)).json();
}

/** Let the browser save a file. */
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
