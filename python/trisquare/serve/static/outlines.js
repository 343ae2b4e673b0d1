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

/** Read a file of outlines: [{file, index, squares}] with corners alone. */
export function readOutlines(text) {
  const members = JSON.parse(text);
  if (members.format !== FORMAT) throw new Error(`The file is not of the format ${FORMAT}.`);
  const pictures = members.pictures ?? [members];
  return pictures.map((picture) => ({
    file: picture.file,
    index: picture.index,
    squares: picture.squares.map((square) => ({
      kind: square.inner ? "frame" : "square",
      corners: cornersOf(square),
      inner: square.inner ? cornersOf(square.inner) : null,
    })),
  }));
}

function cornersOf(outline) {
  const corners = outline.corners ?? outline.sides?.map((side) => side[0]) ?? outline.polygon;
  const isFine = Array.isArray(corners) && corners.length === 4
    && corners.every((point) => point.length === 2 && point.every(Number.isFinite));
  if (!isFine) throw new Error("A square in the file has not four corners.");
  return corners;
}
