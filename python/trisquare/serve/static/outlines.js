// The outlines of one photograph, with a history for undo.

export const FORMAT = "trisquare-outlines/1";
const BY_CORNERS = new Set(["square", "frame", "tag", "rectangle"]);

let numbers = 0;

/** Returns a square for the editor; corners are in pixels of the photograph as it is stored. */
export function squareOf({ kind = "square", corners, inner = null, sides = null }, state) {
  return { id: ++numbers, kind, corners, inner, sides, state, reason: "", isUsed: true };
}

/** Returns whether four corners define it; a board has more, which only a search finds. */
export function isByCorners({ kind }) {
  return BY_CORNERS.has(kind);
}

export class Outlines {
  #past = [];
  #future = [];

  constructor() {
    this.squares = [];
    this.isEdited = false;
  }

  /** Saves the current state before a change by hand. */
  remember() {
    this.#past.push(this.#copy());
    this.#future = [];
    this.isEdited = true;
  }

  get canUndo() { return this.#past.length > 0; }
  get canRedo() { return this.#future.length > 0; }

  undo() { this.#exchange(this.#past, this.#future); }
  redo() { this.#exchange(this.#future, this.#past); }

  #exchange(from, to) {
    if (!from.length) return;
    to.push(this.#copy());
    ({ squares: this.squares, isEdited: this.isEdited } = from.pop());
  }

  #copy() { return structuredClone({ squares: this.squares, isEdited: this.isEdited }); }

  /** Replaces the outlines by those that a search has found. */
  replace(found) {
    this.squares = found.map((one) => squareOf(one, "found"));
    this.isEdited = false;
  }

  byId(id) { return this.squares.find((square) => square.id === id); }

  /** The squares that are not rejected. */
  get used() { return this.squares.filter(({ isUsed }) => isUsed); }

  /** Returns the outlines in trisquare's own format, which the option --outline reads. */
  members() {
    return this.used.filter(isByCorners).map(memberOf);
  }
}

export function memberOf({ corners, inner }) {
  return inner ? { corners, inner: { corners: inner } } : { corners };
}

/** Reads a file of outlines: [{file, index, width, height, squares}], squares by corners. */
export function readOutlines(text) {
  let members = null;
  try {
    members = JSON.parse(text);
  } catch {
    throw new Error("The file is not JSON.");
  }
  if (members?.format !== FORMAT) throw new Error(`The file is not of the format ${FORMAT}.`);
  const pictures = [members.pictures ?? members].flat();
  if (!pictures.every((picture) => Array.isArray(picture?.squares))) {
    throw new Error("The file has no list of squares for a picture.");
  }
  return pictures.map((picture) => ({
    ...picture,
    squares: picture.squares.map((square) => ({
      kind: square?.inner ? "frame" : "square",
      corners: cornersOf(square),
      inner: square?.inner ? cornersOf(square.inner) : null,
    })),
  }));
}

function cornersOf(outline) {
  const starts = Array.isArray(outline?.sides) ? outline.sides.map((side) => side?.[0]) : outline?.polygon;
  const corners = outline?.corners ?? starts;
  const isFine = Array.isArray(corners) && corners.length === 4
    && corners.every((point) => point?.length === 2 && point.every?.(Number.isFinite));
  if (!isFine) throw new Error("A square in the file does not have four corners.");
  return corners;
}
