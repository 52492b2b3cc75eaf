// Saving a picture as it stands, as SVG or PNG, and the numbers behind it as CSV.

const xml = (text) => String(text).replace(/[&<>"]/g, (sign) => `&#${sign.charCodeAt(0)};`);
const short = (value) => String(Math.round(100 * value) / 100);

// What views ask of a canvas, written as SVG.
class SvgContext {
  constructor(canvas) {
    // Widths of texts are those of the canvas.
    this.ruler = canvas.getContext("2d");
    Object.assign(this, { parts: [], path: [], kept: [], clips: 0, clipped: "", dash: [] });
    Object.assign(this, { globalAlpha: 1, lineWidth: 1, strokeStyle: "", fillStyle: "", font: "", textAlign: "left", textBaseline: "alphabetic" });
  }
  setTransform() {}
  clearRect() {}
  setLineDash(dash) { this.dash = dash; }
  beginPath() { this.path = []; }
  moveTo(x, y) { this.path.push(`M${short(x)} ${short(y)}`); }
  lineTo(x, y) { this.path.push(`${this.path.length ? "L" : "M"}${short(x)} ${short(y)}`); }
  closePath() { this.path.push("Z"); }
  rect(x, y, w, h) { this.path.push(`M${short(x)} ${short(y)}h${short(w)}v${short(h)}h${short(-w)}Z`); }
  arc(x, y, r, from, to, back = false) {
    const at = (angle) => `${short(x + r * Math.cos(angle))} ${short(y + r * Math.sin(angle))}`;
    const turn = Math.min(2 * Math.PI, Math.abs(to - from));
    const middle = from + (back ? -turn : turn) / 2;
    const half = (angle) => `A${short(r)} ${short(r)} 0 0 ${back ? 0 : 1} ${at(angle)}`;
    this.path.push(`${this.path.length ? "L" : "M"}${at(from)}${half(middle)}${half(middle + (back ? -turn : turn) / 2)}`);
  }
  stroke() {
    const dash = this.dash.length ? ` stroke-dasharray="${this.dash.join(" ")}"` : "";
    this.add(`<path d="${this.path.join("")}" fill="none" stroke="${xml(this.strokeStyle)}" stroke-width="${this.lineWidth}" stroke-linejoin="round"${dash}`);
  }
  fill() { this.add(`<path d="${this.path.join("")}" fill="${xml(this.fillStyle)}"`); }
  fillRect(x, y, w, h) { this.add(`<rect x="${short(x)}" y="${short(y)}" width="${short(w)}" height="${short(h)}" fill="${xml(this.fillStyle)}"`); }
  measureText(text) {
    this.ruler.font = this.font;
    return this.ruler.measureText(text);
  }
  fillText(text, x, y, most = Infinity) {
    const pressed = this.measureText(text).width > most ? ` textLength="${short(most)}" lengthAdjust="spacingAndGlyphs"` : "";
    this.text(text, x, y, `fill="${xml(this.fillStyle)}"${pressed}`);
  }
  strokeText(text, x, y) { this.text(text, x, y, `fill="none" stroke-linejoin="round" stroke="${xml(this.strokeStyle)}" stroke-width="${this.lineWidth}"`); }
  text(text, x, y, paint) {
    const anchor = { left: "start", center: "middle", right: "end" }[this.textAlign];
    const size = parseFloat(this.font);
    const down = { top: 0.8, middle: 0.35, alphabetic: 0 }[this.textBaseline] * size;
    this.add(`<text x="${short(x)}" y="${short(y + down)}" text-anchor="${anchor}" font-family="system-ui, sans-serif" font-size="${size}" ${paint}`, xml(text), "text");
  }
  add(head, inside = "", tag = "") {
    const alpha = this.globalAlpha < 1 ? ` opacity="${this.globalAlpha}"` : "";
    this.parts.push(tag ? `${head}${alpha}${this.clipped}>${inside}</${tag}>` : `${head}${alpha}${this.clipped}/>`);
  }
  clip() {
    this.clips += 1;
    this.parts.push(`<clipPath id="c${this.clips}"><path d="${this.path.join("")}"/></clipPath>`);
    this.clipped = ` clip-path="url(#c${this.clips})"`;
  }
  save() { this.kept.push(this.clipped); }
  restore() { this.clipped = this.kept.pop(); }
}

function svgOf(view) {
  const canvas = view.context;
  view.context = new SvgContext(view.canvas);
  draw();
  const { parts } = view.context;
  view.context = canvas;
  draw();
  const size = `width="${view.width}" height="${view.height}" viewBox="0 0 ${view.width} ${view.height}"`;
  const paper = `<rect width="100%" height="100%" fill="${xml(view.colours.paper)}"/>`;
  return `<svg xmlns="http://www.w3.org/2000/svg" ${size}>${paper}${parts.join("\n")}</svg>\n`;
}

// Rows of a picture's numbers, a heading first.
function rowsOf(name) {
  if (name === "errors") {
    const claims = state.rivals ? model.claims.map((claim) => claim.name) : [];
    const rows = ladder.filter((row) => row !== null).sort((a, b) => a.epsilon - b.epsilon);
    return [
      [model.epsilon, ...state.orders.map((order) => `order ${order}`), ...claims],
      ...rows.map((row) => [row.epsilon, ...state.orders.map((order) => row.orders[order]), ...claims.map((claim) => row.rivals[claim])]),
    ];
  }
  if (name === "work") return [["run", "tolerance", "error", "operations"], ...work.map((row) => [methodName(row.method), row.rtol, row.error, row.operations])];
  if (name === "scales") {
    const { t, modes } = current.scales;
    return [["t", ...modes.map((_, k) => `time scale ${k + 1}`)], ...Array.from(t, (time, k) => [time, ...modes.map((mode) => Math.pow(10, mode[k]))])];
  }
  const { full, reduced, rivals, fixed } = current.curves;
  const named = [["full", full], ...reduced.map((run) => [`order ${run.order}`, run]), ...rivals.map((run) => [run.name, run])];
  if (fixed) named.push(["fixed steps", fixed]);
  return [["run", "t", ...model.quantities], ...named.flatMap(([run, { t, q }]) => Array.from(t, (time, k) => [run, time, ...q.map((values) => values[k])]))];
}

function csvOf(name) {
  const cell = (value) => {
    if (typeof value !== "string") return Number.isFinite(value) ? String(value) : "";
    // A leading sign would be a formula to a spreadsheet.
    const text = /^[=+\-@]/.test(value) ? `'${value}` : value;
    return /[",\n]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text;
  };
  return rowsOf(name).map((row) => row.map(cell).join(",")).join("\n") + "\n";
}

function offer(blob, name) {
  const link = element("a", { href: URL.createObjectURL(blob), download: name });
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 1000);
}

const SAVED = {
  SVG: (name) => offer(new Blob([svgOf(views[name])], { type: "image/svg+xml" }), `${name}.svg`),
  PNG(name) {
    const { canvas, colours: shown } = views[name];
    const copy = element("canvas", { width: canvas.width, height: canvas.height });
    const context = copy.getContext("2d");
    context.fillStyle = shown.paper;
    context.fillRect(0, 0, copy.width, copy.height);
    context.drawImage(canvas, 0, 0);
    copy.toBlob((blob) => offer(blob, `${name}.png`));
  },
  CSV: (name) => offer(new Blob([csvOf(name)], { type: "text/csv" }), `${name}.csv`),
};

function addSaving(name) {
  const buttons = Object.entries(SAVED).map(([kind, save]) => {
    const button = element("button", { type: "button", title: `Save this picture${kind === "CSV" ? "'s numbers" : ""} as ${kind}` }, kind);
    button.addEventListener("click", () => save(name));
    return button;
  });
  views[name].caption.append(element("span", { class: "save" }, ...buttons));
}
