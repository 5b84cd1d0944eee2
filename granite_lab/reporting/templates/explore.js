"use strict";
(() => {
  const data = JSON.parse(document.getElementById("data").textContent);
  const at = id => document.getElementById(id);
  const [speed, trial, quantity, lines, about, figures] = ["speed", "trial", "quantity", "lines", "about", "figures"].map(at);
  const ALL = "", PALETTE = ["--measured", "--paper", "--measured-light", "--desired", "--grey"];
  const KINDS = [
    ["r", "encoder", "--faint"], ["m", "measured or estimated", "--measured"], ["e", "±2σ", "--measured"],
    ["s", "paper's model", "--simulated"], ["f", data.found, "--fitted"],
  ].filter(([key]) => data.trials.some(t => Object.values(t.curves).some(c => key in c)));
  const off = new Set(), decoded = new Map();
  let range = null;

  const colour = name => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
  const faded = (hex, share) => hex + Math.round(255 * share).toString(16).padStart(2, "0");
  const safe = text => text.replace(/&/g, "&amp;").replace(/</g, "&lt;").replace(/>/g, "&gt;");

  function numbers(text) {  // little-endian floats of four bytes
    if (!decoded.has(text)) {
      const bytes = Uint8Array.from(atob(text), c => c.charCodeAt(0));
      const view = new DataView(bytes.buffer);
      decoded.set(text, Array.from({length: bytes.length / 4}, (_, i) => view.getFloat32(4 * i, true)));
    }
    return decoded.get(text);
  }

  const known = values => values.map(v => Number.isFinite(v) ? v : null);

  function fill(select, options, chosen) {
    select.replaceChildren(...options.map(([value, text]) => new Option(text, value, false, value === chosen)));
  }

  function bands(t, middle, half) {  // one outline for each stretch without a gap
    const x = [], y = [];
    let start = -1;
    for (let i = 0; i <= t.length; i++) {
      const there = i < t.length && Number.isFinite(middle[i]) && Number.isFinite(half[i]);
      if (there && start < 0) start = i;
      if (!there && start >= 0) {
        for (let k = start; k < i; k++) { x.push(t[k]); y.push(middle[k] + half[k]); }
        for (let k = i - 1; k >= start; k--) { x.push(t[k]); y.push(middle[k] - half[k]); }
        x.push(null); y.push(null);
        start = -1;
      }
    }
    return {x, y};
  }

  function traces(chosen, id) {
    const made = [], what = data.quantities[id], several = chosen.length > 1;
    chosen.forEach((one, k) => {
      const c = one.curves[id];
      if (!c) return;
      const t = numbers(c.t), m = c.m && numbers(c.m), e = c.e && numbers(c.e).map(v => 2 * v);
      const name = several ? safe(one.name) + ": " : "", own = several ? PALETTE[k % PALETTE.length] : "--measured";
      const middle = {line: {width: 1.2, color: colour(own)}, ...(e ? {customdata: known(e),
        hovertemplate: "%{y:.4~g} ± %{customdata:.2~g} " + what.unit + " (2σ)<extra>" + name + (what.read ? "measured" : "estimated") + "</extra>"} : {})};
      const add = (key, text, x, y, more = {}) => {
        if (off.has(key)) return;
        made.push({type: "scatter", mode: "lines", x, y: known(y), name: name + text, line: {width: 1.2}, showlegend: false,
                   hovertemplate: "%{y:.4~g} " + (more.yaxis ? what.gap : what.unit) + "<extra>" + name + text + "</extra>", ...more});
      };
      const filled = (half, middle, more) => ({...bands(t, middle, half), type: "scatter", mode: "lines", fill: "toself",
        line: {width: 0}, hoverinfo: "skip", showlegend: false, ...more});
      const kind = what.read ? "measured" : "estimated";
      if (m && e && !what.read && !off.has("e") && !off.has("m")) made.push(filled(e, m, {fillcolor: faded(colour(own), .22)}));
      if (e && !off.has("e") && k === 0) {
        const half = e.map(v => v * what.factor);
        made.push(filled(half, half.map(() => 0), {fillcolor: faded(colour("--grey"), .2), yaxis: "y2", xaxis: "x2"}));
      }
      if (m && what.read) add("m", kind, t, m, middle);  // a noisy line lies below the smooth ones, a smooth one above
      if (c.r) add("r", "encoder", numbers(c.rt), numbers(c.r), {line: {width: .8, color: colour("--faint")}});
      for (const [key, text, tone] of [["s", "paper's model", "--simulated"], ["f", data.found, "--fitted"]]) {
        if (!c[key]) continue;
        const y = numbers(c[key]);
        add(key, text, t, y, {line: {width: 2.2, color: colour(tone)}});
        if (m) add(key, text + ", difference", t, y.map((v, i) => (v - m[i]) * what.factor),
                   {line: {width: 1.2, color: colour(tone)}, yaxis: "y2", xaxis: "x2"});
      }
      if (m && !what.read) add("m", kind, t, m, middle);
    });
    return made;
  }

  function layout(chosen, id) {
    const what = data.quantities[id], ink = colour("--text"), grid = colour("--line");
    const axis = {gridcolor: grid, zerolinecolor: grid, linecolor: grid, tickcolor: grid, automargin: true, fixedrange: false};
    const time = {...axis, ...(range ? {range} : {}), hoverformat: ".3f"};
    const narrow = innerWidth < 560;
    const [a, b] = chosen.length ? chosen[0].steady : [null, null];
    return {
      margin: {l: narrow ? 44 : 58, r: 8, t: 28, b: 36}, paper_bgcolor: "transparent", plot_bgcolor: "transparent",
      font: {color: ink, size: narrow ? 11 : 12, family: getComputedStyle(document.body).fontFamily}, hovermode: "x unified", dragmode: narrow ? false : "zoom",  // a finger scrolls the page
      modebar: {bgcolor: "transparent", color: colour("--muted"), activecolor: colour("--text")},
      hoverlabel: {bgcolor: colour("--card"), bordercolor: grid, font: {color: ink, size: 12}},
      xaxis: {...time, anchor: "y", matches: "x2", showticklabels: false}, xaxis2: {...time, anchor: "y2", title: {text: "time since the start of the command [s]"}},
      yaxis: {...axis, domain: [.36, 1], title: {text: `[${what.unit}]`}, zeroline: false}, yaxis2: {...axis, domain: [0, .3], title: {text: `difference [${what.gap}]`}},
      shapes: a === null ? [] : [{type: "rect", xref: "x2", yref: "paper", x0: a, x1: b, y0: 0, y1: 1, layer: "below", line: {width: 0}, fillcolor: faded(colour("--grey"), .12)}],
      annotations: data.kind === "virtual" ? [{text: "virtual data", xref: "paper", yref: "paper", x: 0, y: 1, xanchor: "left", yanchor: "bottom", showarrow: false, font: {size: 11, color: colour("--muted")}}] : [],
    };
  }

  const config = {displaylogo: false, responsive: true, modeBarButtons: [["zoom2d", "pan2d", "zoomIn2d", "zoomOut2d", "resetScale2d"], ["toImage"]]};

  function follow(div) {  // a stretch that is chosen in one figure is shown in all
    div.on("plotly_relayout", change => {
      const end = k => ["xaxis", "xaxis2"].map(x => change[`${x}.range[${k}]`] ?? change[`${x}.range`]?.[k]).find(v => v !== undefined);
      const a = end(0), b = end(1);
      const all = change["xaxis.autorange"] || change["xaxis2.autorange"];
      if (a === undefined && !all) return;
      const next = all ? null : [a, b];
      if (String(next) === String(range)) return;
      range = next;
      for (const other of document.querySelectorAll(".plot.js-plotly-plot"))
        if (other !== div) Plotly.relayout(other, range ? {"xaxis2.range": range.slice()} : {"xaxis2.autorange": true});
    });
  }

  const watch = new IntersectionObserver(seen => {
    for (const {isIntersecting, target} of seen) if (isIntersecting) { watch.unobserve(target); show(target); }
  }, {rootMargin: "600px"});

  function show(div) {
    const chosen = selected(), id = div.dataset.quantity, fresh = !div.classList.contains("js-plotly-plot");
    Plotly.react(div, traces(chosen, id), layout(chosen, id), config).then(() => fresh && follow(div));
  }

  const ofSpeed = () => data.trials.filter(t => speed.value === ALL || String(t.speed) === speed.value);
  const selected = () => ofSpeed().filter(t => trial.value === ALL || t.name === trial.value);

  function draw() {
    const chosen = selected();
    const names = Object.keys(data.quantities).filter(id => chosen.some(t => t.curves[id]));
    const wanted = names.filter(id => quantity.value === "motion" ? !data.quantities[id].search
      : quantity.value === "search" ? data.quantities[id].search : id === quantity.value);
    about.textContent = chosen.length === 1
      ? `${chosen[0].name}, ${chosen[0].speed} m/s${chosen[0].good ? "" : "; the estimate of the motion is doubtful"}. Grey: the steady part of the motion. Lower panels: simulated minus measured, grey ±2σ.`
      : `${chosen.length} trials: ${chosen.map(t => t.name).join(", ")}.`;
    watch.disconnect();
    figures.replaceChildren(...wanted.map(id => {
      const figure = document.createElement("figure"), caption = document.createElement("figcaption"), div = document.createElement("div");
      caption.textContent = data.quantities[id].name[0].toUpperCase() + data.quantities[id].name.slice(1);
      div.className = "plot"; div.dataset.quantity = id;
      figure.append(caption, div);
      watch.observe(div);
      return figure;
    }));
    const said = new URLSearchParams({trial: trial.value, speed: speed.value, quantity: quantity.value});
    history.replaceState(null, "", "#" + said);
  }

  function list() {
    const names = ofSpeed().map(t => t.name);
    fill(trial, [...names.map(n => [n, n]), [ALL, speed.value === ALL ? "all trials" : "all of this speed"]], names.includes(trial.value) ? trial.value : names[0]);
  }

  function start() {
    const said = new URLSearchParams(location.hash.slice(1)), first = data.trials.find(t => t.name === said.get("trial"));
    const speeds = [...new Set(data.trials.map(t => String(t.speed)))];
    const asked = first ? String(first.speed) : said.get("speed");
    fill(speed, [...speeds.map(s => [s, s + " m/s"]), [ALL, "all speeds"]], speeds.includes(asked) || asked === ALL ? asked : speeds[0]);
    list();
    if (first || said.get("trial") === ALL) trial.value = said.get("trial");
    const own = Object.entries(data.quantities), group = (title, of) => {
      const g = document.createElement("optgroup");
      g.label = title;
      g.append(...of.map(([id, q]) => new Option(q.name, id)));
      return g;
    };
    const motion = own.filter(([, q]) => !q.search), search = own.filter(([, q]) => q.search);
    quantity.replaceChildren(new Option("all of the motion", "motion"), ...(search.length ? [new Option("all sensors of the search", "search")] : []),
      group("Motion", motion), ...(search.length ? [group("Sensors of the search", search)] : []));
    const wish = said.get("quantity");
    if (wish && [...quantity.options].some(o => o.value === wish)) quantity.value = wish;
    lines.append(...KINDS.map(([key, text, tone]) => {
      const label = document.createElement("label"), box = document.createElement("input"), swatch = document.createElement("span");
      box.type = "checkbox"; box.checked = !off.has(key);
      box.addEventListener("change", () => { box.checked ? off.delete(key) : off.add(key); refresh(); });
      swatch.className = "swatch"; swatch.style.background = `var(${tone})`; swatch.style.opacity = key === "e" ? .35 : 1;
      label.append(box, swatch, text);
      return label;
    }));
    draw();
  }

  const refresh = () => document.querySelectorAll(".plot.js-plotly-plot").forEach(show);
  speed.addEventListener("change", () => { range = null; list(); draw(); });
  trial.addEventListener("change", draw);
  quantity.addEventListener("change", draw);
  document.querySelector(".choice").addEventListener("submit", e => e.preventDefault());
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", refresh);
  addEventListener("hashchange", () => { lines.querySelectorAll("label").forEach(l => l.remove()); range = null; start(); });
  start();
})();
