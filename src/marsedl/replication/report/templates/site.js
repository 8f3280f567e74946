"use strict";
(() => {
const every = (selector, root = document) => [...root.querySelectorAll(selector)];

// Filter: by verdict, where numbers and statements are apart, and by text.
const form = document.querySelector("form.filter");
const claims = every("details.claim");
const filter = () => {
  const show = form.elements.show.value, text = form.elements.text.value.trim().toLowerCase();
  for (const claim of claims) {
    const found = `${claim.dataset.named} ${claim.textContent}`.toLowerCase().includes(text);
    claim.hidden = (show && claim.dataset.group !== show) || !found;
  }
  for (const fold of every("details.bound")) fold.open = Boolean((show || text) && fold.querySelector("details.claim:not([hidden])"));
  const left = claims.filter((claim) => !claim.hidden).length;
  form.querySelector("output").textContent = `${left} of ${claims.length} claims`;
};
const ask = (show, text) => {
  const radio = every("input[name=show]", form).find((one) => one.value === show);
  if (radio) radio.checked = true;
  form.elements.text.value = text || "";
  filter();
};
if (form) {
  form.hidden = false;
  form.addEventListener("submit", (event) => event.preventDefault());
  form.addEventListener("input", () => {
    filter();
    const asked = [["show", form.elements.show.value], ["text", form.elements.text.value.trim()]].filter(([, value]) => value);
    history.replaceState(null, "", "#" + (asked.length ? new URLSearchParams(asked) : "claims"));
  });
  const all = form.querySelector("button");
  all.addEventListener("click", () => {
    const open = all.textContent === "unfold all";
    for (const claim of claims) claim.open = open;
    all.textContent = open ? "fold all" : "unfold all";
  });
}

// An address unfolds what it leads to; #show=numbers.differs and #text=mass filter the claims.
const reveal = () => {
  const hash = decodeURIComponent(location.hash.slice(1)), target = hash && document.getElementById(hash);
  if (form && hash.includes("=")) {
    const asked = new URLSearchParams(hash);
    ask(asked.get("show") || "", asked.get("text"));
    document.getElementById("claims").scrollIntoView();
    return;
  }
  // Claims, errata and inputs of a paper stand on its second page.
  if (hash && !target && document.body.dataset.evidence) location.replace(document.body.dataset.evidence + location.hash);
  if (!target) return;
  if (form && target.closest("details.claim[hidden]")) ask("");
  for (let part = target.closest("details"); part; part = part.parentElement.closest("details")) part.open = true;
  target.scrollIntoView();
};
addEventListener("hashchange", reveal);
reveal();

// Pictures wait until they are near, but not for a printer.
const load = () => { for (const image of every("img[loading=lazy]")) image.loading = "eager"; };
addEventListener("beforeprint", load);
addEventListener("load", () => setTimeout(load, 2000));

// Search over all pages: the library and its data are fetched when the field is first used.
const field = document.getElementById("search"), list = document.getElementById("hits");
const fetched = (name) => new Promise((resolve) => {
  document.head.append(Object.assign(document.createElement("script"), {src: `assets/${name}`, onload: resolve}));
});
let index = null;
const ready = () => index ||= Promise.all([fetched("minisearch.js"), fetched("search-data.js")]).then(() => {
  const made = new MiniSearch({fields: ["title", "text", "kind"], storeFields: ["href", "title", "kind"]});
  made.addAll(SEARCHED.map(([href, kind, title, text], id) => ({id, href, kind, title, text})));
  return made;
});
const search = async () => {
  const made = await ready();
  const found = made.search(field.value, {prefix: true, fuzzy: 0.2, boost: {title: 3}, combineWith: "AND"}).slice(0, 12);
  list.replaceChildren(...found.map(({href, title, kind}) => {
    const item = document.createElement("li"), link = document.createElement("a"), small = document.createElement("small");
    link.href = href;
    small.textContent = kind;
    link.append(title, small);
    item.append(link);
    return item;
  }));
  if (!found.length && field.value.trim()) list.append(Object.assign(document.createElement("li"), {textContent: "Nothing found."}));
};
field.closest("search").hidden = false;
field.addEventListener("focus", ready);
field.addEventListener("input", search);
const leave = () => list.replaceChildren();
addEventListener("keydown", (event) => {
  if (event.key === "Escape" && list.children.length) { leave(); field.focus(); }
  if (event.key === "/" && !/INPUT|SELECT/.test(document.activeElement.tagName)) { event.preventDefault(); field.focus(); }
  const step = {ArrowDown: 1, ArrowUp: -1}[event.key], links = every("a", list);
  if (!step || !links.length || !field.closest("search").contains(document.activeElement)) return;
  event.preventDefault();
  const next = links.indexOf(document.activeElement) + step;
  (links[next] || field).focus();
});
addEventListener("click", (event) => { if (!field.closest("search").contains(event.target) || event.target.closest("#hits a")) leave(); });
})();
