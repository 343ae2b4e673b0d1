// The page: photographs, their outlines, the calibration.

import { ask, askFile, askFiles, askJson, jsonBlob, save, status } from "./api.js";
import { Camera } from "./camera.js";
import { Editor } from "./editor.js";
import { FORMAT, Outlines, isByCorners, memberOf, readOutlines, squareOf } from "./outlines.js";
import { Results } from "./results.js";

const byId = (id) => document.getElementById(id);
const pictures = [];
let current = null;
let limits = null;
let expecting = null;

// Status and errors.

function say(text) {
  byId("status").textContent = text;
}

function fail(text) {
  byId("problem").textContent = text;
  byId("problem").hidden = !text;
}

/** Runs an action, with its description as the status; shows an error if it fails. */
async function working(text, act) {
  fail("");
  try {
    return await said(text, act);
  } catch (error) {
    if (error.name !== "AbortError") fail(error.message);
    return undefined;
  }
}

/** Runs an action, with its description as the status. */
async function said(text, act) {
  say(`${text} …`);
  try {
    return await act();
  } finally {
    say("");
  }
}

const editor = new Editor(byId("editor"), { changed: (square) => changed(square) });
editor.onDrawn = (corners) => {
  const square = squareOf({ corners }, "drawn");
  editor.add(square);
  changed(square);
};
const results = new Results({ failed: fail, working });
const camera = new Camera(
  {
    section: byId("camera"), video: byId("video"), svg: byId("live"), advice: byId("advice"),
    byItself: byId("by-itself"),
    bars: {
      fx: { meter: byId("bar-fx"), text: byId("text-fx") },
      cx: { meter: byId("bar-cx"), text: byId("text-cx") },
    },
  },
  { taken: (blob, name) => addPictures([new File([blob], name, { type: blob.type })]), failed: fail },
);

// Photographs.

/** Adds photographs, and frames of videos; an error of one file does not affect the others. */
async function addPictures(files) {
  const problems = [];
  fail("");
  for (const file of files) {
    try {
      const frames = isVideo(file) ? await said(`Choosing frames of ${file.name}`, () => framesOf(file)) : [file];
      for (const picture of frames) await said(`Reading ${picture.name}`, () => addPicture(picture));
    } catch ({ message }) {
      problems.push(message.includes(file.name) ? message : `${file.name}: ${message}`);
      fail(problems.join("\n"));
    }
  }
}

async function addPicture(file) {
  const picture = { name: file.name, blob: file, outlines: new Outlines(), rejected: [] };
  const [preview, found] = await Promise.all([
    askFile("preview", [["picture", file, file.name]]), found_in(picture),
  ]);
  picture.bitmap = await createImageBitmap(preview.blob);
  picture.size = found.image_size;
  take(picture, found);
  pictures.push(picture);
  results.hide();
  show(picture);
}

function isVideo({ name, type }) {
  return type.startsWith("video/") || !!limits?.videos.some((ending) => name.toLowerCase().endsWith(ending));
}

/** Returns photographs from a video: sharp frames that differ. */
async function framesOf(video) {
  const frames = await askFiles("frames", [["picture", video, video.name]]);
  const name = video.name.replace(/\.\w+$/, "");
  return frames.map((frame) => new File([frame], `${name}-${frame.name}`, { type: frame.type }));
}

function found_in(picture) {
  return ask("find", [["picture", picture.blob, picture.name]], { targets: targets() });
}

function targets() {
  return byId("targets").value.trim() || "auto";
}

function take(picture, { found, rejected }) {
  picture.outlines.replace(found);
  picture.rejected = rejected;
}

function show(picture) {
  current = picture;
  for (const id of ["outlines", "settings"]) byId(id).hidden = !picture;
  listPictures();
  if (!picture) return results.hide();
  editor.show(picture);
  update();
  results.showPicture(pictures.indexOf(picture));
}

function listPictures() {
  byId("pictures").replaceChildren(...pictures.map((picture) => {
    const item = document.createElement("li");
    const choose = button(picture.name, () => show(picture));
    choose.setAttribute("aria-current", picture === current);
    const remove = button("Remove", () => {
      pictures.splice(pictures.indexOf(picture), 1);
      results.hide();
      show(pictures.at(-1) ?? null);
    });
    remove.setAttribute("aria-label", `Remove ${picture.name}`);
    item.append(choose, " ", remove);
    return item;
  }));
}

function button(text, act) {
  const node = document.createElement("button");
  Object.assign(node, { type: "button", textContent: text, onclick: act });
  return node;
}

// Outlines.

/** Updates the page after a change by hand; measures a square that was moved or drawn. */
async function changed(square) {
  if (editor.isDrawing && square === null) editor.draw(false);
  update();
  if (square) await measure(current, square);
}

/** Measures the edges at a square, and moves it onto them. */
async function measure(picture, square) {
  const outlines = { format: FORMAT, squares: [memberOf(square)] };
  const corners = JSON.stringify(square.corners);
  try {
    const options = { outlines, targets: targets() };
    const { found, rejected } = await ask("find", [["picture", picture.blob, picture.name]], options);
    const now = picture.outlines.byId(square.id);
    if (!now || JSON.stringify(now.corners) !== corners) return; // moved in the meantime
    if (found.length) Object.assign(now, found[0], { state: "measured", reason: "" });
    else Object.assign(now, { state: "refused", reason: shortened(rejected[0]?.reason) });
  } catch (error) {
    const now = picture.outlines.byId(square.id);
    if (now) Object.assign(now, { state: "refused", reason: shortened(error.message) });
  }
  if (picture === current) update();
}

/** Returns a reason without the key of the square in the file of outlines. */
function shortened(reason = "it cannot be measured") {
  return reason.replace(/^"?squares\[\d+\](\.\w+)?"?:? ?/, "").replace(/^.*?: ("?squares\S* ?)/, "");
}

function update() {
  editor.render();
  const { outlines, rejected } = current;
  byId("undo").disabled = !outlines.canUndo;
  byId("redo").disabled = !outlines.canRedo;
  byId("draw").setAttribute("aria-pressed", editor.isDrawing);
  byId("squares").replaceChildren(
    ...outlines.squares.map((square, index) => listed(square, index)),
    ...(outlines.isEdited ? [] : rejected.map(({ kind, reason }) => told(`A ${kind} was not used: ${reason}`))),
  );
  const leftOut = pictures.flatMap(boardsLeftOut);
  byId("left-out").hidden = !leftOut.length;
  byId("left-out").textContent = `Outlines were changed by hand: only squares are used. Not used: ${
    leftOut.join(", ")}. Undo or Find again uses them again.`;
  expect();
}

/** Returns whether only the drawn squares are used. */
function isByHand() {
  return pictures.some(({ outlines }) => outlines.isEdited);
}

/** Returns the targets of a search that cannot be drawn, and are left out once squares are drawn. */
function boardsLeftOut({ name, outlines }) {
  const boards = isByHand() ? outlines.used.filter((one) => !isByCorners(one)) : [];
  return boards.map(({ kind }) => `the ${kind} of ${name}`);
}

function told(text) {
  const item = document.createElement("li");
  const reason = document.createElement("span");
  Object.assign(reason, { className: "reason", textContent: text });
  item.append(reason);
  return item;
}

const STATES = { found: "found", measured: "measured", drawn: "drawn", refused: "cannot be measured" };

function listed(square, index) {
  const item = document.createElement("li");
  const name = `${square.kind[0].toUpperCase()}${square.kind.slice(1)} ${index + 1}`;
  const label = document.createElement("label");
  label.className = "check";
  const use = document.createElement("input");
  Object.assign(use, { type: "checkbox", checked: square.isUsed });
  use.onchange = () => {
    current.outlines.remember();
    current.outlines.byId(square.id).isUsed = use.checked;
    update();
    byId("squares").querySelectorAll("input")[index].focus();
  };
  label.append(use, ` ${name}, ${STATES[square.state]}`);
  const remove = button("Delete", () => editor.remove(square));
  remove.setAttribute("aria-label", `Delete ${name}`);
  item.append(label, remove);
  if (square.reason) item.append(told(square.reason).firstChild);
  return item;
}

/** Shows the predicted precision of this photograph's outlines. */
async function expect() {
  expecting?.abort();
  expecting = new AbortController();
  const { outlines: { used }, size } = current;
  const isExpected = (one) => one.state !== "refused" && (!isByHand() || isByCorners(one));
  const outlines = used.filter(isExpected).map(({ kind, corners, inner, sides }) => ({
    kind, corners, ...(inner && { inner }), ...(sides && { sides }),
  }));
  try {
    const { std, advice } = await askJson("predict", { image_size: size, outlines }, expecting.signal);
    const numbers = std
      ? `Expected of this photograph: fx ± ${std.fx.toPrecision(2)} px, cx ± ${std.cx.toPrecision(2)} px. `
      : "";
    byId("expected").textContent = numbers + advice;
  } catch (error) {
    if (error.name !== "AbortError") byId("expected").textContent = error.message;
  }
}

function undo(again) {
  if (!current) return;
  if (again) current.outlines.redo();
  else current.outlines.undo();
  update();
}

function saveOutlines() {
  const drawn = pictures.map(({ name, outlines, size: [width, height] }) => ({
    file: name, width, height, squares: outlines.members(),
  }));
  save(jsonBlob({ format: FORMAT, pictures: drawn }), "outlines.json");
}

async function loadOutlines(input) {
  const [file] = input.files;
  if (!file) return;
  fail("");
  try {
    const drawn = readOutlines(await file.text());
    const loaded = drawn.map((own) => [pictureOf(own, drawn.length), own]).filter(([picture]) => picture);
    if (!loaded.length) {
      const names = drawn.map(({ file: name, index }) => name ?? `picture ${index ?? "without a name"}`);
      throw new Error(`The outlines are of other photographs than these: ${names.join(", ")}.`);
    }
    for (const [picture, own] of loaded) {
      picture.outlines.remember();
      picture.outlines.squares = own.squares.map((one) => squareOf(one, "drawn"));
    }
    update();
    for (const [picture] of loaded) {
      for (const square of picture.outlines.squares) await measure(picture, square);
    }
  } catch (error) {
    fail(`${file.name}: ${error.message}`);
  }
  input.value = "";
}

/** Returns the photograph of outlines: by its name, by its index, or else the one that is shown. */
function pictureOf({ file, index, width, height }, count) {
  const name = file?.split(/[\\/]/).at(-1);
  const picture = file ? pictures.find((one) => one.name === name)
    : index === undefined && count === 1 ? current : pictures[index];
  const own = picture?.size.join(" x ");
  const stated = picture && [width ?? picture.size[0], height ?? picture.size[1]].join(" x ");
  if (stated !== own) throw new Error(`The outlines are of a picture of ${stated} pixels, but ${picture.name} has ${own}.`);
  return picture;
}

// Calibration.

function options() {
  const fix = [...document.querySelectorAll("input[name=fix]:checked")].map(({ value }) => value);
  const chosen = { model: byId("model").value, fix, targets: targets(), lines: byId("lines").checked };
  if (chosen.fix.includes("distortion")) chosen.model = "none";
  if (isByHand()) {
    const drawn = pictures.map(({ outlines }, index) => ({ index, squares: outlines.members() }));
    chosen.outlines = { format: FORMAT, pictures: drawn.filter(({ squares }) => squares.length) };
  }
  return chosen;
}

async function calibrate() {
  const used = [...pictures], chosen = options();
  results.hide();
  if (chosen.outlines?.pictures.length === 0) return fail("No square is used: draw one, tick its box, or undo.");
  byId("calibrate").disabled = true;
  const tellRejected = (rejected) => {
    for (const picture of used) picture.rejected = [];
    for (const one of rejected) used[one.image]?.rejected.push(one);
    update();
  };
  const answer = await working("Calibrating", async () => {
    try {
      return await ask("calibrate", used.map(({ blob, name }) => ["picture", blob, name]), chosen);
    } catch (error) {
      tellRejected(error.rejected ?? []);
      throw error;
    }
  });
  byId("calibrate").disabled = false;
  if (!answer) return;
  tellRejected(answer.result.rejected ?? []);
  const shown = results.show(answer, used, used.indexOf(current));
  byId("results").focus();
  await shown;
}

// Event handlers.

byId("files").onchange = async ({ target }) => {
  await addPictures([...target.files]);
  target.value = "";
};
byId("close-problem").onclick = () => fail("");
byId("open-camera").onclick = () => {
  fail("");
  camera.open();
};
byId("close-camera").onclick = () => camera.close();
byId("take").onclick = () => camera.take();
byId("draw").onclick = () => {
  editor.draw(!editor.isDrawing);
  update();
};
byId("add").onclick = () => {
  const [width, height] = current.size.map((length) => length / 2);
  const half = Math.min(width, height) / 3;
  const square = squareOf({ corners: [[-1, -1], [1, -1], [1, 1], [-1, 1]]
    .map(([x, y]) => [width + x * half, height + y * half]) }, "drawn");
  editor.add(square);
  update();
};
byId("undo").onclick = () => undo(false);
byId("redo").onclick = () => undo(true);
byId("find").onclick = () => working("Searching", async () => {
  const picture = current;
  const found = await found_in(picture);
  picture.outlines.remember();
  take(picture, found);
  update();
});
byId("save-outlines").onclick = saveOutlines;
byId("load-outlines").onchange = ({ target }) => loadOutlines(target);
byId("calibrate").onclick = calibrate;
document.addEventListener("keydown", (event) => {
  const isText = event.target.matches?.("input[type=text]");
  if (event.key === "Escape" && editor.isDrawing) changed(null);
  if (isText || !(event.ctrlKey || event.metaKey) || event.key.toLowerCase() !== "z") return;
  event.preventDefault();
  undo(event.shiftKey);
});

const drop = byId("drop");
for (const kind of ["dragenter", "dragover", "dragleave", "drop"]) {
  document.addEventListener(kind, (event) => {
    event.preventDefault();
    drop.classList.toggle("over", kind === "dragenter" || kind === "dragover");
  });
}
document.addEventListener("drop", ({ dataTransfer }) => addPictures([...dataTransfer.files]));

working("Connecting", async () => {
  limits = await status();
  const choice = ({ name, title }) => new Option(title ? `${name} (${title})` : name, name);
  byId("format").replaceChildren(...limits.formats.map(choice));
  byId("model").replaceChildren(...limits.models.map((name) => new Option(name, name, name === "radial2", name === "radial2")));
});
