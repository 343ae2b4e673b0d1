// The result of a calibration: numbers, pictures and files.

import { ask, askFile, jsonBlob, save } from "./api.js";

const byId = (id) => document.getElementById(id);

/** Formats a number with the digits that its standard deviation justifies. */
function rounded(value, std) {
  if (!std) return Number(value.toPrecision(6)).toString();
  const digits = Math.max(0, 1 - Math.floor(Math.log10(std)));
  return value.toFixed(Math.min(digits, 12));
}

function cell(name, text, scope) {
  const node = document.createElement(name);
  node.textContent = text;
  if (scope) node.scope = scope;
  return node;
}

export class Results {
  #answer = null;
  #pictures = [];
  #urls = new Map();

  constructor({ failed, working }) {
    Object.assign(this, { failed, working });
    byId("save-result").onclick = () => save(jsonBlob(this.#answer.result), "camera.json");
    byId("save-report").onclick = () => this.#save("report", this.#pictures, "result");
    byId("save-undistorted").onclick = () => this.#save("undistort", [this.#shown], "camera");
    byId("save-camera").onclick = () => this.#save(
      `convert/${byId("format").value}`, [], "camera", { approximate: byId("approximate").checked },
    );
    byId("earlier").onchange = (event) => this.#compare(event.target);
  }

  hide() { byId("results").hidden = true; }

  /** Shows an answer of /api/calibrate to these pictures, each {blob, name}. */
  async show(answer, pictures, index) {
    this.#answer = answer;
    this.#pictures = pictures;
    const warnings = byId("warnings");
    warnings.hidden = answer.warnings.length === 0;
    const lines = answer.warnings.map(({ code, text }) => cell("li", `${text} [${code}]`));
    warnings.querySelector("ul").replaceChildren(...lines);
    byId("parameters").replaceChildren(...answer.parameters.map((one) => this.#row(one)));
    byId("diagnosis").replaceChildren(...Object.entries(answer.diagnosis).flatMap(
      ([name, { limits, remedy }]) => [cell("dt", name), cell("dd", `Limited by: ${limits}. ${remedy}.`)],
    ));
    byId("comparison").textContent = "";
    byId("results").hidden = false;
    await this.showPicture(index);
  }

  #row({ name, value, std }) {
    const row = document.createElement("tr");
    const number = (text) => Object.assign(cell("td", text), { className: "number" });
    row.append(
      cell("th", name, "row"), number(rounded(value, std)),
      number(std === null ? "fixed" : std.toPrecision(2)),
    );
    return row;
  }

  /** Shows the result drawn over one of the pictures. */
  async showPicture(index) {
    this.#shown = this.#pictures[index];
    if (!this.#shown || byId("results").hidden) return;
    const picture = ["picture", this.#shown.blob, this.#shown.name];
    const json = jsonBlob(this.#answer.result);
    await this.working("Drawing the pictures", async () => {
      const [overlay, straight] = await Promise.all([
        askFile("overlay", [picture, ["result", json, "result.json"]], { index }),
        askFile("undistort", [picture, ["camera", json, "camera.json"]], { shown: true }),
      ]);
      this.#put("overlay", overlay.blob);
      this.#put("undistorted", straight.blob);
    });
  }

  #shown = null;

  #put(id, blob) {
    URL.revokeObjectURL(this.#urls.get(id));
    this.#urls.set(id, URL.createObjectURL(blob));
    byId(id).src = this.#urls.get(id);
  }

  async #save(route, pictures, field, options = {}) {
    const json = jsonBlob(this.#answer.result);
    const files = [...pictures.map(({ blob, name }) => ["picture", blob, name]), [field, json, "result.json"]];
    await this.working("Preparing the file", async () => {
      const { blob, name } = await askFile(route, files, options);
      save(blob, name);
    });
  }

  async #compare(input) {
    const [file] = input.files;
    if (!file) return;
    const files = [["first", jsonBlob(this.#answer.result), "now.json"], ["second", file, file.name]];
    byId("comparison").textContent = "";
    await this.working("Comparing", async () => {
      const { verdict } = await ask("compare", files);
      byId("comparison").textContent = `${verdict[0].toUpperCase()}${verdict.slice(1)}.`;
    });
    input.value = "";
  }
}
