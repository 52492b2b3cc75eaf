// The body of a story on its path: outlines, wheels and springs, with what is named at it.

// Names are left out of a body that is smaller than this, in pixels.
const NAMED = 70;
// From near, the picture is at least so many times as high as half a body.
const NEAR = 1.25;
// Turns of a spring where the story does not say.
const COILS = 8;

// A number, or the value of a quantity or a parameter at time t.
function valueOf(model, s, curves, value, t) {
  if (typeof value === "number") return value;
  const place = model.quantities.indexOf(value);
  return place < 0 ? s.parameters[model.parameters.indexOf(value)] : valueAt(curves.full, place, t);
}

// A path in the plane of two quantities, with the body where a story has one. From near it is the body that fills the
// picture, at its start until time runs.
function drawPath(view, model, s, curves, { path, body }, now, colours, near = false) {
  view.begin(colours);
  const reach = body ? body.reach : 0;
  const along = body ? body.at : path;
  const places = along.map((value) => model.quantities.indexOf(value));
  const { t: times } = curves.full;
  const t = now ?? times[near ? 0 : times.length - 1];
  const at = along.map((value) => valueOf(model, s, curves, value, t));
  const range = (k) => {
    if (near) return [at[k] - NEAR * reach, at[k] + NEAR * reach];
    const ends = places[k] < 0 ? Array(2).fill(valueOf(model, s, curves, along[k], s.span[0])) : rangeOf(curves, places[k]);
    return [ends[0] - reach, ends[1] + reach];
  };
  view.setRanges(range(0), range(1), { equal: true, steady: !near });
  view.axes(...along.map((value) => (typeof value === "number" ? "" : model.labelled(value))));
  view.clipped(() => {
    if (!places.includes(-1)) drawCurves(view, curves, ...places, colours);
    if (body) drawBody(view, body, at, (value) => valueOf(model, s, curves, value, t), colours);
    else view.dot(...at, colours.ink);
  });
}

// Every part, in pixels; `read` gives the value of a number or a name.
function drawBody(view, body, at, read, colours) {
  const c = view.context;
  const turn = read(body.angle);
  const unit = Math.abs(view.X(1) - view.X(0));
  const placed = (part) => ([a, b]) => {
    const [u, v] = [read(a), read(b)];
    if (part.fixed) return [view.X(u), view.Y(v)];
    const [cos, sin] = [Math.cos(turn), Math.sin(turn)];
    return [view.X(at[0] + u * cos - v * sin), view.Y(at[1] + u * sin + v * cos)];
  };
  const line = (points, closed = false) => {
    c.beginPath();
    points.forEach(([x, y], k) => (k ? c.lineTo(x, y) : c.moveTo(x, y)));
    if (closed) c.closePath();
  };
  const filled = (alpha) => {
    c.fillStyle = colours.manifold;
    c.globalAlpha = alpha;
    c.fill();
    c.globalAlpha = 1;
  };
  const word = (text, ...place) => text && unit * body.reach > NAMED && view.word(text, ...place, colours.ink);
  const kinds = {
    points(part, points) {
      line(points, part.closed);
      if (part.closed) filled(0.35);
      c.stroke();
    },
    wheel(part, [[x, y]]) {
      const radius = part.radius * unit;
      c.beginPath();
      c.arc(x, y, radius, 0, 2 * Math.PI);
      filled(0.2);
      c.stroke();
      const angle = read(part.angle ?? 0) + (part.fixed ? 0 : turn);
      line([[x, y], [x + radius * Math.cos(angle), y - radius * Math.sin(angle)]]);
      c.stroke();
    },
    spring(part, [[x0, y0], [x1, y1]]) {
      const coils = part.coils ?? COILS;
      const length = Math.hypot(x1 - x0, y1 - y0) || 1;
      const [nx, ny] = [(-7 * (y1 - y0)) / length, (7 * (x1 - x0)) / length];
      const points = [[x0, y0]];
      for (let k = 0; k < 2 * coils; k++) {
        const share = 0.1 + (0.8 * (k + 0.5)) / (2 * coils);
        const side = k % 2 ? 1 : -1;
        points.push([x0 + share * (x1 - x0) + side * nx, y0 + share * (y1 - y0) + side * ny]);
      }
      line([...points, [x1, y1]]);
      c.stroke();
    },
    dot(part, [[x, y]]) {
      c.beginPath();
      c.arc(x, y, 4.5, 0, 2 * Math.PI);
      c.fillStyle = c.strokeStyle;
      c.fill();
      word(part.name, x + 8, y + 11);
    },
    length(part, [[x0, y0], [x1, y1]]) {
      const size = Math.hypot(x1 - x0, y1 - y0) || 1;
      const [nx, ny] = [(-5 * (y1 - y0)) / size, (5 * (x1 - x0)) / size];
      for (const [x, y] of [[x0, y0], [x1, y1]]) {
        line([[x - nx, y - ny], [x + nx, y + ny]]);
        c.stroke();
      }
      line([[x0, y0], [x1, y1]]);
      c.stroke();
      word(part.name, (x0 + x1) / 2 - 3 + 2.2 * nx, (y0 + y1) / 2 + 2.2 * ny);
    },
    arrow(part, [[x0, y0], [x1, y1]]) {
      const size = Math.hypot(x1 - x0, y1 - y0);
      if (!(size > 1)) return;
      const [ux, uy] = [(x1 - x0) / size, (y1 - y0) / size];
      const head = Math.min(9, size);
      line([[x0, y0], [x1, y1]]);
      c.stroke();
      line([[x1, y1], [x1 - head * ux + 4 * uy, y1 - head * uy - 4 * ux], [x1 - head * ux - 4 * uy, y1 - head * uy + 4 * ux]], true);
      c.fillStyle = c.strokeStyle;
      c.fill();
      word(part.name, x1 + 8 * ux + 4, y1 + 8 * uy);
    },
    // The angle from the axis across to the body.
    turn(part, [[x, y]]) {
      const angle = read(part.to);
      const whole = angle - 2 * Math.PI * Math.floor(angle / (2 * Math.PI));
      const radius = Math.max(34, 0.6 * unit * body.reach);
      c.setLineDash([3, 3]);
      line([[x, y], [x + 1.5 * radius, y]]);
      c.stroke();
      c.setLineDash([]);
      c.beginPath();
      c.arc(x, y, radius, 0, -whole, true);
      c.stroke();
      word(part.name, x + 1.25 * radius * Math.cos(whole / 2) - 4, y - 1.25 * radius * Math.sin(whole / 2));
    },
  };
  for (const part of body.parts) {
    c.strokeStyle = part.strong ? colours.rivals[0] : colours.ink;
    c.lineWidth = part.strong ? 5 : part.kind === "turn" || part.kind === "length" ? 1 : 1.5;
    kinds[part.kind](part, part.points.map(placed(part)));
  }
}
