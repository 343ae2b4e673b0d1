"use strict";
for (const slider of document.querySelectorAll("input[data-split]")) {
  const move = () => slider.parentElement.style.setProperty("--split", `${slider.value}%`);
  slider.addEventListener("input", move);
  // The browser may restore an earlier position of the slider.
  move();
}

// The scene, in parallel projection. Views: angles beside and above the camera, degrees.
const VIEWS = { side: [40, 24], above: [0, 90], camera: [0, 0] };
const KEYS = {
  ArrowLeft: (view) => { view.beside -= 5; }, ArrowRight: (view) => { view.beside += 5; },
  ArrowUp: (view) => { view.above += 5; }, ArrowDown: (view) => { view.above -= 5; },
  "+": (view) => { view.zoom *= 1.2; }, "=": (view) => { view.zoom *= 1.2; },
  "-": (view) => { view.zoom /= 1.2; }, Home: (view) => view.look("side"),
};
const DEGREES_PER_PIXEL = 0.5;
const FILLED = 0.85; // initial size of the scene, as a fraction of the picture

class Scene {
  constructor(figure) {
    const { camera, planes } = JSON.parse(figure.dataset.scene);
    Object.assign(this, { camera, planes, svg: figure.querySelector("svg"), image: null });
    this.series = Number(figure.dataset.series);
    figure.hidden = false;
    const { svg } = this;
    svg.addEventListener("keydown", (event) => {
      if (!KEYS[event.key] || event.ctrlKey || event.altKey || event.metaKey) return;
      event.preventDefault();
      this.change(KEYS[event.key]);
    });
    svg.addEventListener("pointerdown", (event) => svg.setPointerCapture(event.pointerId));
    svg.addEventListener("pointermove", (event) => {
      if (!svg.hasPointerCapture(event.pointerId)) return;
      this.change((view) => {
        view.beside -= event.movementX * DEGREES_PER_PIXEL;
        view.above += event.movementY * DEGREES_PER_PIXEL;
      });
    });
    // The wheel is used only if the scene has the focus, so that the page can be scrolled past it.
    svg.addEventListener("wheel", (event) => {
      if (document.activeElement !== svg) return;
      event.preventDefault();
      this.change((view) => { view.zoom *= Math.exp(-event.deltaY / 500); });
    }, { passive: false });
    for (const button of figure.querySelectorAll("button")) {
      const { view, key } = button.dataset;
      button.addEventListener("click", () => this.change(view ? () => this.look(view) : KEYS[key]));
    }
    const chooser = figure.querySelector("select");
    chooser?.addEventListener("change", () => {
      this.image = chooser.value === "" ? null : Number(chooser.value);
      this.refit();
    });
    this.look("side");
    this.draw();
    new ResizeObserver(() => this.refit()).observe(svg);
  }

  look(name) {
    [this.beside, this.above] = VIEWS[name];
    this.zoom = 1;
    this.fit = null;
  }

  change(how) {
    how(this);
    this.beside = ((this.beside % 360) + 360) % 360;
    this.above = Math.min(90, Math.max(-90, this.above));
    this.zoom = Math.min(20, Math.max(0.2, this.zoom));
    this.draw();
  }

  refit() {
    this.fit = null;
    this.draw();
  }

  /** Returns the directions, in the camera's frame, that point right, down and away on the screen. */
  axes() {
    const [beside, above] = [this.beside, this.above].map((degrees) => degrees * Math.PI / 180);
    const [c, s, C, S] = [Math.cos(beside), Math.sin(beside), Math.cos(above), Math.sin(above)];
    return [[c, 0, s], [S * s, C, -S * c], [-C * s, S, C * c]];
  }

  draw() {
    const { width, height } = this.svg.getBoundingClientRect();
    if (!width) return;
    const shown = this.planes.filter(({ image }) => this.image === null || image === this.image);
    const points = [[0, 0, 0], ...this.camera, ...shown.flatMap(({ corners }) => corners)];
    // The centre of rotation is the middle of the bounding box.
    const ends = [0, 1, 2].map((axis) => points.map((point) => point[axis]));
    const middle = ends.map((values) => (Math.min(...values) + Math.max(...values)) / 2);
    const [right, down, away] = this.axes();
    const along = (point, axis) => axis.reduce((sum, v, i) => sum + v * (point[i] - middle[i]), 0);
    const reach = (axis) => Math.max(...points.map((point) => Math.abs(along(point, axis))));
    this.fit ??= FILLED / 2 * Math.min(width / reach(right), height / reach(down));
    const scale = this.zoom * this.fit;
    const place = (point) => [right, down].map((axis) => scale * along(point, axis));
    const mean = (corners) => [0, 1, 2].map((i) => corners.reduce((sum, p) => sum + p[i], 0) / 4);
    const fixed = (point) => place(point).map((value) => value.toFixed(2));
    const path = (corners, end) => `M${corners.map(fixed).join("L")}${end}`;

    const planes = shown.map(({ number, corners }) => ({ number, corners, centre: mean(corners) }));
    planes.sort((a, b) => along(b.centre, away) - along(a.centre, away));
    const parts = planes.map(({ number, corners, centre }) => element("g", {
      style: `--plane: var(--plane-${number % this.series})`,
    }, [
      element("path", { class: "sight", d: path([[0, 0, 0], centre], "") }),
      element("path", { class: "plane", d: path(corners, "Z") }),
    ]));
    const [a, b, c, d] = this.camera;
    parts.push(element("path", {
      class: "pyramid",
      d: path(this.camera, "Z") + [a, b, c, d].map((p) => path([[0, 0, 0], p], "")).join(""),
    }));
    parts.push(element("path", { class: "pyramid upper", d: path([a, b], "") }));
    const [x, y] = place([0, 0, 0]);
    parts.push(label("camera", [x, y + 18]));
    parts.push(...planes.map(({ number, centre }) => label(number, place(centre))));
    this.svg.setAttribute("viewBox", `${-width / 2} ${-height / 2} ${width} ${height}`);
    this.svg.replaceChildren(...parts);
  }
}

function element(name, attributes, children = []) {
  const made = document.createElementNS("http://www.w3.org/2000/svg", name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  made.append(...children);
  return made;
}

function label(text, [x, y]) {
  return element("text", { x: x.toFixed(2), y: y.toFixed(2) }, [String(text)]);
}

for (const figure of document.querySelectorAll("[data-scene]")) new Scene(figure);
