// The outlines of one photograph, with what was done to them, so that it can be undone.

export const FORMAT = "trisquare-outlines/1";
const BY_CORNERS = new Set(["square", "frame", "tag", "rectangle"]);

let numbers = 0;

/** A square as the editor has it; corners in pixels of the photograph as it is stored. */
export function squareOf({ kind = "square", corners, inner = null, sides = null }, state) {
  return { id: ++numbers, kind, corners, inner, sides, state, reason: "", isUsed: true };
}

/** Whether four corners tell all of it: more is measured of a board, which only a search finds. */
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

  /** Remember how it is, before something is changed by hand. */
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

  /** Take what a search has found. */
  replace(found) {
    this.squares = found.map((one) => squareOf(one, "found"));
    this.isEdited = false;
  }

  byId(id) { return this.squares.find((square) => square.id === id); }

  /** Those that are not rejected. */
  get used() { return this.squares.filter(({ isUsed }) => isUsed); }

  /** In trisquare's own format, as the option --outline reads it. */
  members() {
    return this.used.filter(isByCorners).map(memberOf);
  }
}

export function memberOf({ corners, inner }) {
  return inner ? { corners, inner: { corners: inner } } : { corners };
}

/** Read a file of outlines: [{file, index, width, height, squares}], the squares by their corners. */
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
    throw new Error("The file has not a list of squares for each picture.");
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
  if (!isFine) throw new Error("A square in the file has not four corners.");
  return corners;
}
