"use strict";
// What universes say of a claim while a reader turns the knobs. Their rows are fetched when the fold is first opened.
(() => {
const fold = document.getElementById("explorer"), root = fold.querySelector(".explorer");
const make = (name, properties = {}, ...inside) => {
  const one = Object.assign(document.createElement(name), properties);
  one.append(...inside);
  return one;
};
const shape = (name, attributes, ...inside) => {
  const one = document.createElementNS("http://www.w3.org/2000/svg", name);
  for (const [key, value] of Object.entries(attributes)) one.setAttribute(key, value);
  one.append(...inside);
  return one;
};
const written = (value) => Number(value.toPrecision(4)).toString();
const plural = (count, what) => `${count} ${what}${count === 1 ? "" : "s"}`;
const ANY = "any", RIM = 16;

const start = () => {
  const {numbers, verdicts, knobs, answers} = UNIVERSES;
  const claim = make("select", {}, ...answers.map((one, at) => make("option", {value: at}, one.said)));
  const chosen = knobs.map((knob) => make("select", {}, make("option", {value: ANY}), ...knob.values.map((_, at) => make("option", {value: at}))));
  const labels = knobs.map((knob, at) => make("label", {}, knob.said, chosen[at]));
  const all = make("button", {type: "button"}, "all knobs to any"), none = make("button", {type: "button"}, "all knobs to ours");
  const told = make("output"), picture = make("div");
  const setAll = (of) => { chosen.forEach((select, at) => { select.value = of(knobs[at]); }); show(); };

  // Which universes have the values that are set, of all knobs or of all but one.
  const matching = (but = -1) => {
    const set = chosen.map((select, at) => (select.value === ANY || at === but ? null : [knobs[at].places, Number(select.value)])).filter(Boolean);
    return numbers.map((_, k) => k).filter((k) => set.every(([places, value]) => places[k] === value));
  };
  const command = () => {
    const turned = knobs.flatMap((knob, at) => (chosen[at].value === ANY || Number(chosen[at].value) === knob.ours ? [] : [`${knob.choice}=${knob.values[chosen[at].value][0]}`]));
    return turned.length ? `marsedl what-if ${fold.dataset.paper} ${turned.join(" ")}` : "";
  };
  const mark = (one) => (one.is_statement ? "limit" : "printed");
  const group = (k, one) => { const [, stands, refuted] = verdicts[one.verdicts[k]]; return stands ? "true" : refuted ? "false" : "open"; };

  const draw = (left, one) => {
    const values = left.map((k) => one.values[k]).sort((a, b) => a - b);
    const at = (share) => values[Math.round(share * (values.length - 1))];
    const ends = [at(0.02), at(0.98), ...(one.mark === null ? [] : [one.mark])];
    const low = Math.min(...ends), span = Math.max(...ends) - low || Math.abs(low) || 1;
    const width = root.clientWidth < 500 ? 360 : 720;
    const place = (value) => RIM + (width - 2 * RIM) * Math.min(Math.max((value - low) / span, 0), 1);
    const lanes = {true: 36, open: 74, false: 112}, words = {true: "true", open: "undetermined", false: "differs or fails"};
    const svg = shape("svg", {viewBox: `0 0 ${width} 158`, role: "img", "aria-label": told.textContent});
    if (one.mark !== null) {
      svg.append(shape("line", {x1: place(one.mark), x2: place(one.mark), y1: 15, y2: 138}));
      svg.append(shape("text", {x: place(one.mark), y: 12, "text-anchor": place(one.mark) < width / 2 ? "start" : "end"}, mark(one)));
    }
    for (const [name, y] of Object.entries(lanes)) svg.append(shape("text", {x: 4, y: y - 10, opacity: 0.75}, words[name]));
    left.forEach((k, count) => {
      const name = group(k, one);
      const dot = shape("circle", {cx: place(one.values[k]), cy: lanes[name] + (count % 5) * 3, r: numbers[k] ? 3.5 : 6, class: name});
      dot.append(shape("title", {}, `universe ${numbers[k]}: ${written(one.values[k])} ${one.unit}, ${verdicts[one.verdicts[k]][0]}`));
      svg.append(dot);
    });
    const ticks = [[low, "start"], [low + span, "end"]];
    for (const [value, anchor] of ticks) svg.append(shape("text", {x: place(value), y: 153, "text-anchor": anchor}, written(value)));
    return svg;
  };

  const show = () => {
    const one = answers[claim.value], left = matching(), result = left.filter((k) => one.values[k] !== null);
    const unit = one.unit === "1" ? "" : ` ${one.unit}`, printed = one.mark === null ? "" : ` The ${one.is_statement ? "limit" : "printed number"} is ${written(one.mark)}${unit}.`;
    const counts = ["true", "open", "false"].map((name) => left.filter((k) => group(k, one) === name && verdicts[one.verdicts[k]][0] !== "none").length);
    const typical = result.map((k) => one.values[k]).sort((a, b) => a - b);
    const parts = [`${plural(left.length, "universe")} of ${numbers.length} left.`];
    if (result.length === 1) {
      const [k] = result, error = one.errors ? ` ± ${one.errors[k]}` : "";
      parts.push(`Universe ${numbers[k]} gives ${written(one.values[k])}${error}${unit}: ${verdicts[one.verdicts[k]][0]}.`);
    } else if (result.length) {
      const middle = typical[Math.floor(typical.length / 2)];
      const none = left.length - counts[0] - counts[1] - counts[2];
      parts.push(`True in ${counts[0]}, undetermined in ${counts[1]}, false in ${counts[2]}${none ? `, without a result in ${none}` : ""}. From ${written(typical[0])} to ${written(typical.at(-1))}${unit}, half of them below ${written(middle)}.`);
    } else if (left.length) parts.push(left.length === 1 ? `Universe ${numbers[left[0]]} has no number: ${verdicts[one.verdicts[left[0]]][0]}.` : "None of them has a number.");
    else parts.push("None was computed with these answers together: set a knob to any.");
    const asked = command();
    told.replaceChildren(parts.join(" ") + printed, ...(asked ? [make("br"), "With nothing else changed: ", make("code", {}, asked)] : []));
    picture.replaceChildren(...(result.length ? [draw(result, one)] : []));
    knobs.forEach((knob, at) => {
      const without = matching(at);
      [...chosen[at].options].forEach((option) => {
        const place = option.value === ANY ? null : Number(option.value);
        const count = place === null ? without.length : without.filter((k) => knob.places[k] === place).length;
        option.textContent = `${place === null ? ANY : knob.values[place][1]}${place === knob.ours ? ", ours" : ""} (${count})`;
      });
      labels[at].className = chosen[at].value === String(knob.ours) ? "" : "turned";
    });
  };

  all.addEventListener("click", () => setAll(() => ANY));
  none.addEventListener("click", () => setAll((knob) => knob.ours));
  const form = make("form", {}, make("label", {className: "wide"}, "Claim", claim), told, picture, ...labels, make("div", {}, all, " ", none));
  form.addEventListener("submit", (event) => event.preventDefault());
  form.addEventListener("input", show);
  told.setAttribute("aria-live", "polite");
  root.replaceChildren(make("p", {}, "Behind each answer stands how many universes have it, with the other knobs as they are."), form);
  setAll((knob) => knob.ours);
};

let asked = false;
const begin = () => {
  if (!fold.open || asked) return;
  asked = true;
  document.head.append(Object.assign(document.createElement("script"), {src: fold.dataset.rows, onload: start}));
};
fold.addEventListener("toggle", begin);
begin(); // an address may have opened it before this script ran
})();
