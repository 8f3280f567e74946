// Plots of the report that a reader can look into; the data of each stands in its figure.
"use strict";
(() => {
const clamp = (value, least, most) => Math.min(Math.max(value, least), most);
const WIDTH = innerWidth < 640 ? 400 : 720, HEIGHT = innerWidth < 640 ? 340 : 460;  // so that text stays legible
const LEFT = 66, RIGHT = 18, TOP = 16, BOTTOM = 50;
const COLOURS = ["#0072B2", "#D55E00", "#009E73", "#CC79A7"];  // told apart by marks and dashes as well
const node = (name, attributes, ...children) => {
  const made = document.createElementNS("http://www.w3.org/2000/svg", name);
  for (const [key, value] of Object.entries(attributes || {})) made.setAttribute(key, value);
  made.append(...children);
  return made;
};
const element = (name, properties, ...children) => {
  const made = Object.assign(document.createElement(name), properties);
  made.append(...children);
  return made;
};
const curve = (points) => "M" + points.map(([x, y]) => x.toFixed(1) + " " + y.toFixed(1)).join("L");
const shown = (value, unit) => (value === null ? "none" : String(value).replace("-", "−") + (unit && (unit === "°" ? unit : " " + unit)));
const named = ({name, unit}) => name + (unit ? " (" + unit + ")" : "");

const ticks = (least, most) => {
  const rough = (most - least) / 5, decade = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].map((m) => m * decade).find((s) => s >= rough);
  const digits = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
  const found = [];
  for (let k = Math.ceil(least / step - 1e-9); k * step <= most + 1e-9 * step; k++) found.push([k * step, (k * step).toFixed(digits).replace("-", "−")]);
  return found;
};
const scales = ([x0, x1], [y0, y1]) => [
  (x) => LEFT + (x - x0) / (x1 - x0) * (WIDTH - LEFT - RIGHT),
  (y) => HEIGHT - BOTTOM - (y - y0) / (y1 - y0) * (HEIGHT - TOP - BOTTOM),
];
const axes = (xs, ys, xName, yName, X, Y) => {
  const drawn = node("g", {"aria-hidden": "true"});
  for (const [x, label] of ticks(...xs)) drawn.append(
    node("line", {class: "grid", x1: X(x), x2: X(x), y1: TOP, y2: HEIGHT - BOTTOM}),
    node("text", {x: X(x), y: HEIGHT - BOTTOM + 18, "text-anchor": "middle"}, label));
  for (const [y, label] of ticks(...ys)) drawn.append(
    node("line", {class: "grid", x1: LEFT, x2: WIDTH - RIGHT, y1: Y(y), y2: Y(y)}),
    node("text", {x: LEFT - 7, y: Y(y) + 4, "text-anchor": "end"}, label));
  drawn.append(
    node("path", {class: "axis", d: curve([[LEFT, TOP], [LEFT, HEIGHT - BOTTOM], [WIDTH - RIGHT, HEIGHT - BOTTOM]])}),
    node("text", {x: (LEFT + WIDTH - RIGHT) / 2, y: HEIGHT - 10, "text-anchor": "middle"}, xName),
    node("text", {transform: `translate(16 ${(TOP + HEIGHT - BOTTOM) / 2}) rotate(-90)`, "text-anchor": "middle"}, yName));
  return drawn;
};
const mark = (kind, x, y, size, attributes) => {
  const s = size;
  if (kind === 0) return node("circle", {cx: x, cy: y, r: s, ...attributes});
  const shape = [null, [[-s, -s], [s, -s], [s, s], [-s, s]], [[0, -1.3 * s], [1.2 * s, s], [-1.2 * s, s]], [[0, -1.4 * s], [1.4 * s, 0], [0, 1.4 * s], [-1.4 * s, 0]]][kind];
  return node("path", {d: curve(shape.map(([dx, dy]) => [x + dx, y + dy])) + "Z", ...attributes});
};

class Plot {
  constructor(figure) {
    this.data = JSON.parse(figure.querySelector('script[type="application/json"]').textContent);
    this.controls = element("div", {className: "controls"});
    this.output = element("output", {});
    this.svg = node("svg", {viewBox: `0 0 ${WIDTH} ${HEIGHT}`, tabindex: "0", role: "img",
      "aria-label": figure.querySelector("h3").textContent, "aria-describedby": figure.querySelector("figcaption").id});
    this.output.setAttribute("aria-live", "polite");
    figure.querySelector(".stage").append(this.controls, this.svg, this.output);
    this.svg.addEventListener("keydown", (event) => {
      if (event.ctrlKey || event.metaKey || event.altKey || !this.key(event.key)) return;
      event.preventDefault();
      this.draw();
    });
  }
  choice(label, names, value = 0) {
    const select = element("select", {}, ...names.map((name, k) => new Option(name, k)));
    select.value = value;
    select.addEventListener("change", () => { this.home(); this.draw(); });
    this.controls.append(element("label", {}, label, select));
    return () => Number(select.value);
  }
  home() {}
  at(event) {
    const box = this.svg.getBoundingClientRect();
    return [(event.clientX - box.left) * WIDTH / box.width, (event.clientY - box.top) * HEIGHT / box.height];
  }
}

class Scatter extends Plot {
  constructor(figure) {
    super(figure);
    const {axes, cases} = this.data, names = axes.map(named);
    this.case = this.choice("flights", cases.map((c) => c.name));
    this.x = this.choice("across", names, 0);
    this.y = this.choice("up", names, 1);
    this.sigma = this.choice("ellipses of", ["1 standard deviation", "2 standard deviations", "3 standard deviations"], 2);
    this.home();
    this.svg.addEventListener("pointermove", (event) => {
      const [px, py] = this.at(event);
      let least = 400;
      this.cases.points.forEach((point, k) => {
        const away = (this.X(point[this.i]) - px) ** 2 + (this.Y(point[this.j]) - py) ** 2;
        if (away < least) [least, this.trial] = [away, k];
      });
      this.draw();
    });
    this.draw();
  }
  get cases() { return this.data.cases[this.case()]; }
  home() { [this.zoom, this.move, this.trial] = [1, [0, 0], null]; }
  key(key) {
    const moved = {ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowDown: [0, -1], ArrowUp: [0, 1]}[key];
    const stepped = {n: 1, N: 1, p: -1, P: -1}[key], count = this.cases.points.length;
    if (moved) this.move = this.move.map((m, k) => m + moved[k] * 0.2 / this.zoom);
    else if (stepped) this.trial = this.trial === null ? (stepped > 0 ? 0 : count - 1) : (this.trial + stepped + count) % count;
    else if (key === "+" || key === "=") this.zoom = Math.min(this.zoom * 1.4, 20);
    else if (key === "-" || key === "−") this.zoom = Math.max(this.zoom / 1.4, 0.2);
    else if (key === "0") this.home();
    else return false;
    return true;
  }
  window(index, shift) {
    const values = this.cases.points.map((point) => point[index]);
    const least = Math.min(...values), most = Math.max(...values), half = 0.56 * (most - least || 1) / this.zoom;
    const middle = (least + most) / 2 + shift * (most - least || 1);
    return [middle - half, middle + half];
  }
  draw() {
    const {points, ellipses, replay} = this.cases, {axes: quantities} = this.data, sigma = this.sigma() + 1;
    const [i, j] = [this.i, this.j] = [this.x(), this.y()];
    const xs = this.window(i, this.move[0]), ys = this.window(j, this.move[1]);
    const [X, Y] = [this.X, this.Y] = scales(xs, ys);
    const inside = (x, y) => x >= xs[0] && x <= xs[1] && y >= ys[0] && y <= ys[1];
    const dots = points.filter((p) => inside(p[i], p[j])).map((p) => {
      const [x, y] = [X(p[i]).toFixed(1), Y(p[j]).toFixed(1)];
      return `M${x} ${y}h0`;
    }).join("");
    const clip = node("svg", {x: LEFT, y: TOP, width: WIDTH - LEFT - RIGHT, height: HEIGHT - TOP - BOTTOM,
      viewBox: `${LEFT} ${TOP} ${WIDTH - LEFT - RIGHT} ${HEIGHT - TOP - BOTTOM}`},
      node("path", {d: dots, fill: "none", stroke: COLOURS[0], "stroke-width": 3, "stroke-linecap": "round", opacity: 0.45}));
    const said = [], legend = node("g", {});
    ellipses.forEach(({name, mean, covariance}, k) => {
      const [a, b, c] = [covariance[i][i], covariance[i][j], covariance[j][j]];
      const predicted = k < ellipses.length - 1;
      const style = {fill: "none", stroke: predicted ? COLOURS[1] : "#1c1e21", "stroke-width": 2, "stroke-dasharray": predicted ? "7 4" : "none"};
      const root = Math.sqrt(a), lower = b / root, rest = Math.sqrt(Math.max(c - lower * lower, 0));
      const outline = Array.from({length: 97}, (_, n) => {
        const [u, v] = [sigma * Math.cos(n * Math.PI / 48), sigma * Math.sin(n * Math.PI / 48)];
        return [X(mean[i] + root * u), Y(mean[j] + lower * u + rest * v)];
      });
      clip.append(node("path", {d: curve(outline), ...style}));
      legend.append(node("path", {d: `M${LEFT + 14} ${TOP + 14 + 18 * k}h30`, ...style}),
        node("text", {x: LEFT + 52, y: TOP + 18 + 18 * k}, `${sigma} σ, ${name}`));
      if (i === j) return;
      const count = points.filter((p) => {
        const u = (p[i] - mean[i]) / root, v = (p[j] - mean[j] - lower * u) / rest;
        return u * u + v * v <= sigma * sigma;
      }).length;
      said.push(`${(100 * count / points.length).toFixed(1)} % of ${points.length} flights lie in the ellipse ${name}`);
    });
    if (said.length) said.push(`${(100 * (1 - Math.exp(-sigma * sigma / 2))).toFixed(1)} % would if they were Gaussian`);
    if (this.trial !== null) {
      const p = points[this.trial];
      clip.append(node("circle", {cx: X(p[i]), cy: Y(p[j]), r: 6, fill: "none", stroke: "#1c1e21", "stroke-width": 2}));
      said.push(`\nFlight ${this.trial}: ` + quantities.map(({name, unit}, k) => `${name} ${shown(p[k], unit)}`).join(", ") +
        `. Flown again by: ${replay} ${this.trial}`);
    }
    this.svg.replaceChildren(axes(xs, ys, named(quantities[i]), named(quantities[j]), X, Y), clip, legend);
    this.output.textContent = said.join("; ").replace("; \n", "\n");
  }
}

class Tube extends Plot {
  constructor(figure) {
    super(figure);
    const {cases, centre} = this.data;
    this.case = this.choice("funnel", cases.map((c) => c.name));
    this.slider = element("input", {type: "range", min: 0, max: centre.length - 1, value: Math.floor(centre.length / 2)});
    this.slider.addEventListener("input", () => this.draw());
    this.flights = element("input", {type: "checkbox", checked: true});
    this.flights.addEventListener("change", () => this.draw());
    this.controls.append(element("label", {}, "slice", this.slider), element("label", {}, this.flights, "flights"));
    this.home();
    this.svg.addEventListener("pointerdown", (event) => {
      this.svg.setPointerCapture(event.pointerId);
      this.from = this.at(event);
    });
    this.svg.addEventListener("pointermove", (event) => {
      if (!this.svg.hasPointerCapture(event.pointerId)) return;
      const [x, y] = this.at(event);
      this.turn = this.turn + (x - this.from[0]) / 150;
      this.tilt = clamp(this.tilt + (y - this.from[1]) / 150, -Math.PI / 2, Math.PI / 2);
      this.from = [x, y];
      this.draw();
    });
    this.draw();
  }
  home() { [this.turn, this.tilt, this.zoom] = [-0.6, 0.45, 1]; }
  key(key) {
    const stepped = {n: 1, N: 1, p: -1, P: -1}[key];
    if (key === "ArrowLeft") this.turn -= 0.1;
    else if (key === "ArrowRight") this.turn += 0.1;
    else if (key === "ArrowUp") this.tilt = Math.min(this.tilt + 0.1, Math.PI / 2);
    else if (key === "ArrowDown") this.tilt = Math.max(this.tilt - 0.1, -Math.PI / 2);
    else if (key === "+" || key === "=") this.zoom = Math.min(this.zoom * 1.25, 8);
    else if (key === "-" || key === "−") this.zoom = Math.max(this.zoom / 1.25, 0.5);
    else if (key === "0") this.home();
    else if (stepped) this.slider.value = Number(this.slider.value) + stepped;
    else return false;
    return true;
  }
  draw() {
    const {axes: quantities, time, centre, cases} = this.data, {half_axes: halves, flights} = cases[this.case()];
    const chosen = Number(this.slider.value);
    const widths = halves.map((half) => half.map((row) => Math.hypot(...row)));
    const least = [0, 1, 2].map((k) => Math.min(...centre.map((c, n) => c[k] - widths[n][k])));
    const most = [0, 1, 2].map((k) => Math.max(...centre.map((c, n) => c[k] + widths[n][k])));
    const [ct, st, ce, se] = [Math.cos(this.turn), Math.sin(this.turn), Math.cos(this.tilt), Math.sin(this.tilt)];
    // orthographic, of a box whose sides are drawn as 4 : 3 : 2.6
    const size = [4, 3, 2.6].map((side) => side * WIDTH / 8.4 * this.zoom);
    const row = [[ct, -st, 0], [-se * st, -se * ct, -ce]].map((r) => r.map((value, k) => value * size[k] / (most[k] - least[k])));
    const turned = (d) => row.map((r) => r[0] * d[0] + r[1] * d[1] + r[2] * d[2]);
    const place = (p) => {
      const [x, y] = turned(p.map((value, k) => value - (least[k] + most[k]) / 2));
      return [WIDTH / 2 + x, HEIGHT / 2 + y];
    };
    const parts = [];
    const corner = (k) => [0, 1, 2].map((n) => (k >> n & 1 ? most[n] : least[n]));
    for (let k = 0; k < 8; k++) for (let n = 0; n < 3; n++) if (!(k >> n & 1)) {
      parts.push(node("path", {class: "grid", d: curve([place(corner(k)), place(corner(k | 1 << n))])}));
    }
    // each axis along the lowest of its four edges, with two values and its name
    quantities.forEach((quantity, n) => {
      const edges = [0, 1, 2, 3].map((k) => { const low = k & (1 << n) - 1, high = k >> n; return low | high << n + 1; });
      const middle = (k) => { const [a, b] = [place(corner(k)), place(corner(k | 1 << n))]; return [(a[0] + b[0]) / 2, (a[1] + b[1]) / 2]; };
      const outer = (k) => (n === 2 ? -middle(k)[0] : middle(k)[1]);
      const best = edges.reduce((a, b) => (outer(b) > outer(a) + 1e-6 ? b : a));
      const ends = [place(corner(best)), place(corner(best | 1 << n))], [x, y] = middle(best);
      const inner = (e) => [0, 1].map((c) => ends[e][c] + 0.2 * (ends[1 - e][c] - ends[e][c]));
      const away = n === 2 ? [-12, 0] : [0, 26], side = {"text-anchor": n === 2 ? "end" : "middle"};
      parts.push(node("path", {class: "axis", d: curve(ends)}),
        node("text", {x: x + away[0], y: y + 1.4 * away[1], ...side}, named(quantity)),
        ...[0, 1].flatMap((e) => {
          const [[u, v], value] = [inner(e), least[n] + (e ? 0.8 : 0.2) * (most[n] - least[n])];
          return [node("circle", {cx: u, cy: v, r: 2}),
            node("text", {x: u + away[0], y: v + 5 + away[1] / 2, ...side}, shown(Number(value.toPrecision(3)), ""))];
        }));
    });
    const outline = (n) => {
      // the shadow of an ellipsoid is an ellipse
      const m = [0, 1].map((r) => [0, 1, 2].map((c) => [0, 1, 2].reduce((sum, k) => sum + row[r][k] * halves[n][k][c], 0)));
      const dot = (p, q) => p[0] * q[0] + p[1] * q[1] + p[2] * q[2];
      const a = Math.sqrt(dot(m[0], m[0])), b = dot(m[0], m[1]) / a, c = Math.sqrt(Math.max(dot(m[1], m[1]) - b * b, 0));
      const [x, y] = place(centre[n]);
      return curve(Array.from({length: 49}, (_, k) => {
        const [u, v] = [Math.cos(k * Math.PI / 24), Math.sin(k * Math.PI / 24)];
        return [x + a * u, y + b * u + c * v];
      }));
    };
    halves.forEach((_, n) => parts.push(node("path", {d: outline(n), fill: "#56B4E9", "fill-opacity": 0.1, stroke: COLOURS[0], "stroke-opacity": 0.35, "stroke-width": 0.7})));
    if (this.flights.checked) for (const flight of flights) parts.push(node("path", {d: curve(flight.map(place)), fill: "none", stroke: "#E69F00", "stroke-width": 0.8}));
    parts.push(node("path", {d: curve(centre.map(place)), fill: "none", stroke: "#000", "stroke-width": 2.4}));
    parts.push(node("path", {d: outline(chosen), fill: COLOURS[1], "fill-opacity": 0.12, stroke: COLOURS[1], "stroke-width": 2.2}));
    this.svg.replaceChildren(...parts);
    const said = quantities.map(({name, unit}, k) => `${name} ${shown(Number(centre[chosen][k].toFixed(3)), unit)} ± ${shown(Number(widths[chosen][k].toPrecision(3)), unit)}`);
    this.output.textContent = `Slice ${chosen + 1} of ${centre.length}, at ${shown(time[chosen], "s")}: ${said.join(", ")}. ${flights.length} flights drawn.`;
  }
}

class Histories extends Plot {
  constructor(figure) {
    super(figure);
    const {quantities, series} = this.data;
    this.quantity = this.choice("quantity", quantities.map(named));
    this.boxes = series.map((name, k) => {
      const box = element("input", {type: "checkbox", checked: true});
      box.addEventListener("change", () => this.draw());
      const sign = node("svg", {width: 16, height: 14, viewBox: "0 0 16 14", style: "width:16px;border:0"}, mark(k % 4, 8, 7, 4.5, {fill: COLOURS[k % 4]}));
      sign.setAttribute("aria-hidden", "true");
      this.controls.append(element("label", {}, box, sign, name));
      return box;
    });
    this.home();
    this.draw();
  }
  home() { this.step = null; }
  key(key) {
    const moved = {ArrowLeft: -1, ArrowRight: 1}[key], count = this.data.quantities[0].values[0].length;
    if (moved) this.step = this.step === null ? (moved > 0 ? 0 : count - 1) : clamp(this.step + moved, 0, count - 1);
    else if (key === "0" || key === "Home") this.step = 0;
    else if (key === "End") this.step = count - 1;
    else return false;
    return true;
  }
  draw() {
    const {quantities, series, steps} = this.data, {values, errors, unit, name} = quantities[this.quantity()];
    const drawn = series.map((_, k) => k).filter((k) => this.boxes[k].checked);
    const bar = (k, n) => (errors && errors[k][n] !== null ? 3 * errors[k][n] : 0);
    // the initial guess is far from all that follows, so the scale is of the iterations
    const later = values.flatMap((row, k) => row.flatMap((v, n) => (n && v !== null ? [v - bar(k, n), v + bar(k, n)] : [])));
    const [low, high] = later.length ? [Math.min(...later), Math.max(...later)] : [0, 1], rim = 0.06 * (high - low || Math.abs(high) || 1);
    const xs = [-0.4, values[0].length - 0.6], ys = [low - rim, high + rim];
    const [X, Y] = scales(xs, ys);
    const parts = [axes(xs, ys, steps, named({name, unit}), X, Y)];
    if (this.step !== null) parts.push(node("path", {d: curve([[X(this.step), TOP], [X(this.step), HEIGHT - BOTTOM]]), stroke: "#8A8A8A", "stroke-width": 10, opacity: 0.25}));
    let beyond = false;
    for (const k of drawn) {
      const colour = COLOURS[k % 4], points = [];
      values[k].forEach((value, n) => {
        if (value === null) return;
        if (value < ys[0] || value > ys[1]) { beyond = true; return; }
        points.push([X(n), Y(value)]);
        if (bar(k, n)) parts.push(node("path", {d: curve([[X(n), Y(value - bar(k, n))], [X(n), Y(value + bar(k, n))]]), stroke: colour}));
        parts.push(mark(k % 4, X(n), Y(value), 4, {fill: colour}));
      });
      if (points.length) parts.push(node("path", {d: curve(points), fill: "none", stroke: colour, "stroke-width": 1.4, "stroke-dasharray": ["none", "7 3", "2 3", "9 3 2 3"][k % 4]}));
    }
    this.svg.replaceChildren(...parts);
    const said = this.step === null ? [] : drawn.map((k) => `${series[k].split(":")[0]} ${shown(values[k][this.step], unit)}` + (errors ? ` ± ${shown(errors[k][this.step], unit)}` : ""));
    this.output.textContent = (said.length ? `${steps} ${this.step}: ${said.join("; ")}` : "No iteration is chosen.") +
      (beyond ? "\nThe initial guess lies outside of the plot." : "");
  }
}

const kinds = {scatter: Scatter, tube: Tube, histories: Histories};
for (const part of document.querySelectorAll("details.closer")) {
  const figure = part.querySelector("figure");
  const draw = () => new kinds[figure.dataset.kind](figure);
  if (part.open) draw();  // by the address of the page, before this script was there
  else part.addEventListener("toggle", draw, {once: true});
}
})();
