"use strict";
// One time for the moving arm and all charts. What the page holds is in the element `data`: see
// `page.rs` (Data), `series.rs` (curves) and `motion.rs` (the arm).
(() => {
  const $ = (id) => document.getElementById(id);
  const { shown, cases } = JSON.parse($("data").textContent);
  const clamp = (x, low, high) => Math.min(Math.max(x, low), high);
  const signed = (words) => words.replace(/^-/, "\u2212");

  // Curves: differences to values.
  for (const c of cases) for (const panel of c.panels) for (const s of panel.series) {
    let x = 0, y = 0;
    s.x = s.x.map((d) => s.start + s.step * (x += d));
    s.y = s.y.map((d) => (d === null ? null : s.unit * (y += d)));
    s.most = s.y.reduce((most, value) => Math.max(most, Math.abs(value)), 0);
  }
  // The value of a curve at a time; null beyond its ends and in its gaps.
  function valueAt(s, t) {
    const n = s.x.length, close = s.step * 1e-3;
    if (!n || t < s.x[0] - close || t > s.x[n - 1] + close) return null;
    let low = 0, high = n - 1;
    while (high - low > 1) { const middle = (low + high) >> 1; if (s.x[middle] <= t) low = middle; else high = middle; }
    if (s.y[low] === null) return null;
    if (s.y[high] === null || high === low) return t <= s.x[low] + close ? s.y[low] : null;
    return s.y[low] + (s.y[high] - s.y[low]) * clamp((t - s.x[low]) / (s.x[high] - s.x[low]), 0, 1);
  }

  const play = $("play"), speed = $("speed"), slider = $("slider"), bend = $("bend"), stage = $("stage");
  const chooser = $("case"), compared = $("with");
  let index = shown, other = -1, t = 0, playing = false, before = 0, zoom = null, view = null;
  const current = () => cases[index];
  const force = () => current().panels.find((p) => p.title === "contact force");
  // First and last time of a case.
  function span(c) {
    const ends = c.panels.flatMap((p) => p.series).filter((s) => s.x.length);
    const frames = c.motion ? c.motion.t : [];
    const first = Math.min(...ends.map((s) => s.x[0]), ...frames.slice(0, 1));
    const last = Math.max(...ends.map((s) => s.x[s.x.length - 1]), ...frames.slice(-1));
    return first < last ? [first, last] : [0, 1];
  }
  const shownSpan = () => zoom || span(current());

  let colours = {};
  function readColours() {
    const style = getComputedStyle(document.documentElement);
    for (const name of ["ink", "soft", "rule", "grid", "blue", "red", "green", "reference", "link1", "page", "shade"])
      colours[name] = style.getPropertyValue("--" + name).trim();
  }
  const colourOf = (s) => (s.other ? "green" : s.style === "planned" ? "reference" : ["blue", "green"][Number(s.style)]);

  // --- Charts -------------------------------------------------------------------------------------

  let charts = [];
  // Tabulated at all times of its curves, as uPlot wants them.
  function tabulated(series) {
    const times = [...new Set(series.flatMap((s) => s.x.map((x) => Math.round(x * 1e7))))].sort((a, b) => a - b);
    const x = times.map((at) => at / 1e7);
    return [x, ...series.map((s) => x.map((at) => valueAt(s, at)))];
  }
  function curvesOf(panel) {
    const series = panel.series.slice();
    const its = other >= 0 && other !== index && cases[other].panels.find((p) => p.title === panel.title);
    if (its) for (const s of its.series) if (s.style !== "planned") series.push({ ...s, label: `case ${other + 1}`, other: true });
    return series;
  }
  function range(panel) {
    return (u, low, high) => {
      if (low === null || high === null) return [0, 1];
      const [floor, ceiling] = panel.limits;
      if (floor !== null) { low = Math.max(low, floor); high = Math.max(high, floor); }
      if (ceiling !== null) { low = Math.min(low, ceiling); high = Math.min(high, ceiling); }
      if (high - low < panel.span) { const middle = (low + high) / 2; low = middle - panel.span / 2; high = middle + panel.span / 2; }
      const margin = 0.07 * (high - low);
      return [low === floor ? low : low - margin, high + margin];
    };
  }
  const axisNumber = (u, values) => {
    const step = values.length > 1 ? Math.abs(values[1] - values[0]) : 1;
    let digits = 0;
    while (digits < 9 && Math.abs(step - Number(step.toFixed(digits))) > 1e-6 * step) digits++;
    const far = Math.max(...values.map(Math.abs)) >= 1e5 || digits > 6;
    return values.map((v) => (v === null ? "" : signed(far ? v.toExponential(1) : (v + 0).toFixed(digits).replace(/^-(?=0\.?0*$)/, ""))));
  };
  function options(panel, series, width, height) {
    const line = (s) => ({
      label: s.label, stroke: () => colours[colourOf(s)], width: s.style === "planned" ? 3.5 : 1.6,
      spanGaps: false, points: { show: false },
    });
    const axis = (extra) => ({
      stroke: () => colours.soft, grid: { stroke: () => colours.grid, width: 1 }, ticks: { stroke: () => colours.grid, width: 1, size: 4 },
      font: "12px system-ui, sans-serif", values: axisNumber, ...extra,
    });
    const nothing = () => () => null;
    return {
      width, height, pxAlign: 0, legend: { show: false },
      padding: [6, 18, 0, 0],
      scales: { x: { time: false, range: () => shownSpan() }, y: { range: range(panel) } },
      series: [{}, ...series.map(line)],
      axes: [axis({ size: 24, gap: 3, space: 70 }), axis({ size: 64, gap: 4, space: 26 })],
      cursor: {
        y: false, drag: { x: true, y: false, setScale: false, dist: 5 },
        points: { show: false },
        bind: { mouseleave: nothing, dblclick: () => () => zoomTo(null) },
      },
      hooks: {
        setCursor: [(u) => {
          if (quiet || u.cursor.left < 0 || !u.cursor.event) return;
          if (playing) pause();
          t = clamp(u.posToVal(u.cursor.left, "x"), ...span(current()));
          draw();
        }],
        setSelect: [(u) => {
          const { left, width: wide } = u.select;
          if (wide < 5) return;
          const ends = [u.posToVal(left, "x"), u.posToVal(left + wide, "x")];
          u.setSelect({ left: 0, top: 0, width: 0, height: 0 }, false);
          zoomTo(ends);
        }],
      },
    };
  }
  let quiet = false;
  function build() {
    const place = $("charts");
    charts.forEach((c) => c.plot.destroy());
    place.replaceChildren();
    const panels = current().panels;
    charts = panels.map((panel) => {
      const series = curvesOf(panel), data = tabulated(series);
      const box = document.createElement("section"), head = document.createElement("header");
      box.className = "chart";
      const title = document.createElement("h3"), list = document.createElement("ul");
      title.textContent = panel.unit ? `${panel.title} (${panel.unit})` : panel.title;
      list.className = "legend";
      const values = series.map((s) => {
        const item = document.createElement("li"), mark = document.createElement("i"), value = document.createElement("b");
        mark.style.borderColor = `var(--${colourOf(s)})`;
        item.append(mark, `${s.label} `, value);
        list.append(item);
        return value;
      });
      head.append(title, list);
      box.append(head);
      place.append(box);
      const plot = new uPlot(options(panel, series, chartWidth(), chartHeight()), data, box);
      // Dots of our own: uPlot's lie on the curves' points only, which may be far apart.
      const dots = series.map((s) => {
        const mark = document.createElement("div");
        mark.className = "dot";
        mark.style.background = `var(--${colourOf(s)})`;
        plot.over.append(mark);
        return mark;
      });
      plot.root.setAttribute("role", "img");
      plot.root.setAttribute("aria-label", `${panel.title} over time, with a cursor at the chosen time`);
      return { plot, series, values, dots };
    });
  }
  const chartWidth = () => Math.max($("charts").clientWidth - 18, 200);
  const chartHeight = () => (stage ? 118 : 150) + (window.innerWidth < 700 ? 30 : 0);
  function resize() {
    for (const { plot } of charts) if (plot.width !== chartWidth()) plot.setSize({ width: chartWidth(), height: chartHeight() });
    drawLater();
  }
  function zoomTo(ends) {
    const whole = span(current());
    if (ends) {
      const least = (whole[1] - whole[0]) * 1e-4;
      ends = [clamp(ends[0], whole[0], whole[1] - least), clamp(ends[1], whole[0] + least, whole[1])];
      if (ends[1] - ends[0] < least) ends[1] = ends[0] + least;
      if (ends[0] <= whole[0] && ends[1] >= whole[1]) ends = null;
    }
    zoom = ends;
    $("reset").disabled = !zoom;
    if (zoom) t = clamp(t, ...zoom);
    const [min, max] = shownSpan();
    charts.forEach(({ plot }) => plot.setScale("x", { min, max }));
    drawLater();
    remember();
  }
  function scaleBy(factor) {
    const [low, high] = shownSpan(), half = ((high - low) * factor) / 2;
    const middle = clamp(t, low, high);
    zoomTo([middle - half, middle + half]);
  }
  function valueWords(value, s) {
    if (value === null) return "\u2013";
    const size = Math.abs(value);
    // Five digits of the curve's largest value, as many as it has.
    const digits = clamp(4 - Math.floor(Math.log10(s.most || 1)), 0, 9);
    const words = size >= 1e5 || digits > 8 ? value.toExponential(2) : value.toFixed(digits).replace(/^-(?=0\.?0*$)/, "");
    return signed(words);
  }
  function drawCharts() {
    quiet = true;
    const [low, high] = shownSpan();
    for (const { plot, series, values, dots } of charts) {
      const left = plot.valToPos(t, "x"), height = plot.over.clientHeight;
      plot.setCursor({ left: t < low || t > high ? -10 : left, top: 10 });
      series.forEach((s, i) => {
        const value = valueAt(s, t), top = value === null ? -1 : plot.valToPos(value, "y");
        values[i].textContent = valueWords(value, s);
        dots[i].hidden = !(top >= 0 && top <= height && left >= 0 && left <= plot.over.clientWidth);
        dots[i].style.transform = `translate(${left - 3.5}px, ${top - 3.5}px)`;
      });
    }
    quiet = false;
  }

  // --- The arm ------------------------------------------------------------------------------------

  // The frame of an arm at time t, between two stored ones.
  function frame(c) {
    const n = c.t.length;
    let low = 0, high = n - 1;
    while (high - low > 1) { const middle = (low + high) >> 1; if (c.t[middle] <= t) low = middle; else high = middle; }
    const s = high > low ? clamp((t - c.t[low]) / (c.t[high] - c.t[low]), 0, 1) : 0;
    const mix = (a, at) => a[at(low)] + s * (a[at(high)] - a[at(low)]);
    const m = c.intervals - 1, w = [0];
    for (let i = 0; i < m; i++) w.push(c.unit * mix(c.deflection, (k) => k * m + i));
    w.push(0);
    return {
      angle1: mix(c.angle1, (k) => k), angle2: mix(c.angle2, (k) => k),
      target: [0, 1].map((i) => mix(c.target, (k) => 2 * k + i)), w,
    };
  }
  const elbow = (c, a1) => [c.lengths[0] * Math.cos(a1), c.lengths[0] * Math.sin(a1)];

  // Part of the plane that the arm needs, m: down the page is +a2.
  function bounds(c) {
    const box = [0, 0, 0, 0];
    const add = (x, y) => {
      box[0] = Math.min(box[0], x); box[1] = Math.max(box[1], x);
      box[2] = Math.min(box[2], y); box[3] = Math.max(box[3], y);
    };
    c.t.forEach((_, k) => {
      const [x, y] = elbow(c, c.angle1[k]);
      add(x, y);
      add(x + c.lengths[1] * Math.cos(c.angle2[k]), y + c.lengths[1] * Math.sin(c.angle2[k]));
    });
    const reach = c.surface ? 0.2 * (c.lengths[0] + c.lengths[1]) : 0;
    c.path.forEach(([x, y]) => { add(x, y); add(x + reach * c.normal[0], y + reach * c.normal[1]); });
    const margin = 0.07 * (c.lengths[0] + c.lengths[1]);
    return [box[0] - margin, box[1] + margin, box[2] - margin, box[3] + margin];
  }
  function prepare(canvas) {
    const ratio = window.devicePixelRatio || 1;
    const width = canvas.clientWidth, height = canvas.clientHeight;
    const [w, h] = [Math.round(width * ratio), Math.round(height * ratio)];
    if (canvas.width !== w || canvas.height !== h) { canvas.width = w; canvas.height = h; }
    const pen = canvas.getContext("2d");
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    pen.clearRect(0, 0, width, height);
    pen.lineJoin = pen.lineCap = "round";
    pen.font = "13px system-ui, sans-serif";
    return [pen, width, height];
  }
  function stroke(pen, colour, width, points) {
    pen.strokeStyle = colour; pen.lineWidth = width; pen.beginPath();
    points.forEach(([x, y], i) => (i ? pen.lineTo(x, y) : pen.moveTo(x, y)));
    pen.stroke();
  }
  function dot(pen, colour, radius, [x, y]) {
    pen.fillStyle = colour; pen.beginPath(); pen.arc(x, y, radius, 0, 2 * Math.PI); pen.fill();
  }
  // Text with a halo of the background, to be readable on lines.
  function write(pen, colour, words, x, y, align) {
    pen.textAlign = align; pen.textBaseline = "middle";
    pen.lineWidth = 4; pen.strokeStyle = colours.page; pen.strokeText(words, x, y);
    pen.fillStyle = colour; pen.fillText(words, x, y);
  }
  function drawSurface(pen, c, at, scale) {
    const [from, to] = c.path, length = Math.hypot(to[0] - from[0], to[1] - from[1]);
    const u = [(to[0] - from[0]) / length, (to[1] - from[1]) / length];
    // Somewhat longer than the path: where it ends nobody has said.
    const far = 0.1 * length, n = c.normal;
    const on = (s) => at([from[0] + s * u[0], from[1] + s * u[1]]);
    for (let s = -far; s < length + far; s += 11 / scale) {
      const [x, y] = on(s);
      stroke(pen, colours.reference, 1, [[x, y], [x + 9 * (n[0] - u[0]), y + 9 * (n[1] - u[1])]]);
    }
    stroke(pen, colours.soft, 1.5, [on(-far), on(length + far)]);
    stroke(pen, colours.ink, 3, [on(0), on(length)]);
  }
  // Link 2 as points, its bending drawn `factor` times as large.
  function outline(c, now, factor, at) {
    const joint2 = elbow(c, now.angle1), e = [Math.cos(now.angle2), Math.sin(now.angle2)];
    return now.w.map((w, i) => {
      const rho = (c.lengths[1] * i) / c.intervals;
      return at([joint2[0] + rho * e[0] - factor * w * e[1], joint2[1] + rho * e[1] + factor * w * e[0]]);
    });
  }
  function drawForce(pen, c, tip, newton, scale, [width, height]) {
    // The largest planned is as long as a tenth of the arm.
    const n = c.normal, size = (0.1 * (c.lengths[0] + c.lengths[1]) * scale) / Math.max(Math.abs(c.reference), 1e-9);
    const long = clamp(newton * size, -2 * (width + height), 2 * (width + height));
    const end = [tip[0] + n[0] * long, tip[1] + n[1] * long];
    stroke(pen, colours.red, 3, [tip, end]);
    if (Math.abs(long) > 2) {
      const head = Math.min(9, Math.abs(long)) * Math.sign(long);
      pen.fillStyle = colours.red; pen.beginPath(); pen.moveTo(end[0] + n[0] * head * .3, end[1] + n[1] * head * .3);
      for (const side of [-0.55, 0.55])
        pen.lineTo(end[0] - head * (n[0] + side * n[1]), end[1] - head * (n[1] - side * n[0]));
      pen.fill();
    }
    const words = signed(`${newton.toFixed(3)} N`), half = pen.measureText(words).width / 2 + 6;
    write(pen, colours.red, words,
      clamp(end[0] + n[0] * (long < 0 ? -1 : 1) * (half + 6), half, width - half),
      clamp(end[1] + n[1] * (long < 0 ? -1 : 1) * 20, 12, height - 12), "center");
  }
  function drawStage() {
    const c = current().motion;
    if (!stage || !c || !c.t.length) return;
    const now = frame(c), [pen, width, height] = prepare(stage);
    const [x0, x1, y0, y1] = view;
    const scale = Math.min(width / (x1 - x0), height / (y1 - y0));
    const left = (width - scale * (x1 - x0)) / 2, top = (height - scale * (y1 - y0)) / 2;
    const at = ([x, y]) => [left + scale * (x - x0), top + scale * (y - y0)];
    if (c.surface) drawSurface(pen, c, at, scale);
    const factor = Number(bend.value), link = outline(c, now, factor, at), tip = link[c.intervals];
    const joint2 = at(elbow(c, now.angle1));
    const ghost = other >= 0 && other !== index && cases[other].motion;
    if (ghost && ghost.t.length) {
      const its = frame(ghost);
      pen.globalAlpha = 0.7;
      stroke(pen, colours.green, 2, [at([0, 0]), at(elbow(ghost, its.angle1))]);
      stroke(pen, colours.green, 2, outline(ghost, its, factor, at));
      pen.globalAlpha = 1;
    }
    pen.setLineDash([4, 5]);
    stroke(pen, colours.reference, 1, [joint2, tip]);
    pen.setLineDash([]);
    const newton = force() && valueAt(force().series[force().series.length - 1], t);
    stroke(pen, colours.link1, 9, [at([0, 0]), joint2]);
    stroke(pen, colours.blue, 4, link);
    dot(pen, colours.ink, 8, at([0, 0])); dot(pen, colours.page, 4, at([0, 0]));
    dot(pen, colours.ink, 6, joint2); dot(pen, colours.page, 2.5, joint2);
    if (newton !== undefined && newton !== null) drawForce(pen, c, tip, newton, scale, [width, height]);
    dot(pen, colours.ink, 4, tip);
    const [gx, gy] = at(now.target);
    stroke(pen, colours.ink, 1.5, [[gx - 7, gy - 7], [gx + 7, gy + 7]]);
    stroke(pen, colours.ink, 1.5, [[gx - 7, gy + 7], [gx + 7, gy - 7]]);
    write(pen, colours.ink, timeWords(), 10, 16, "left");
    stage.setAttribute("aria-label", `The arm at ${timeWords()}` + (newton ? `; contact force ${newton.toFixed(3)} N` : ""));
  }
  function legend() {
    const c = current().motion;
    if (!stage || !c) return;
    const parts = [["link1", "link 1"], ["blue", "link 2, elastic"]];
    if (c.surface) parts.push(["ink", "path on the surface"], ["red", "force on it"]);
    if (other >= 0 && other !== index) parts.push(["green", `case ${other + 1}`]);
    $("parts").replaceChildren(...parts.map(([colour, words]) => {
      const item = document.createElement("li"), mark = document.createElement("i");
      mark.style.borderColor = `var(--${colour})`;
      item.append(mark, words);
      return item;
    }), Object.assign(document.createElement("li"), { textContent: "\u00d7 where the tip should be" }));
  }

  // --- Time, cases and the page's address ---------------------------------------------------------

  const timeWords = () => `t = ${signed(t.toFixed(4))} s`;
  function draw() {
    const [low, high] = shownSpan();
    slider.value = Math.round((2000 * (t - low)) / (high - low || 1));
    const words = signed(`${t.toFixed(4)} s`);
    $("time").value = words;
    slider.setAttribute("aria-valuetext", words);
    if (bend) $("factor").value = `${bend.value}×`;
    drawStage();
    drawCharts();
  }
  // After the charts have taken in a new scale, which they do once this script is over.
  function drawLater() { queueMicrotask(() => queueMicrotask(draw)); }
  function remember() {
    let fragment = `#case=${index + 1}&t=${t.toFixed(4)}`;
    if (bend && bend.value !== "1") fragment += `&bend=${bend.value}`;
    if (other >= 0) fragment += `&with=${other + 1}`;
    if (zoom) fragment += `&from=${zoom[0].toFixed(5)}&to=${zoom[1].toFixed(5)}`;
    try { history.replaceState(null, "", fragment); } catch { /* some viewers forbid it */ }
  }
  function seek(time) { t = clamp(time, ...shownSpan()); draw(); }
  function pause() { if (!play) return; playing = false; play.textContent = "Play"; remember(); }
  function tick(stamp) {
    if (!playing) return;
    const passed = clamp(stamp - before, 0, 100) / 1000;
    before = stamp;
    seek(t + passed * Number(speed.value));
    if (t >= shownSpan()[1]) pause(); else requestAnimationFrame(tick);
  }
  function toggle() {
    if (playing) return pause();
    if (t >= shownSpan()[1] - 1e-9) t = shownSpan()[0];
    playing = true; play.textContent = "Pause";
    before = performance.now();
    requestAnimationFrame(tick);
  }
  // Shows case i beside case j, which is -1 for none.
  function choose(i, j = other) {
    if (!cases[i]) return;
    index = i; other = cases[j] ? j : -1;
    if (chooser) { chooser.value = i; compared.value = other; }
    if (current().motion && current().motion.t.length) view = bounds(current().motion);
    const whole = span(current());
    if (zoom && (zoom[0] < whole[0] || zoom[1] > whole[1])) zoom = null;
    $("reset").disabled = !zoom;
    t = clamp(t, ...shownSpan());
    for (const row of document.querySelectorAll("[data-case]")) {
      const chosen = Number(row.dataset.case) === i + 1;
      row.classList.toggle("chosen", chosen);
      const link = row.querySelector("a");
      if (chosen) link.setAttribute("aria-current", "true"); else link.removeAttribute("aria-current");
    }
    legend();
    build();
    drawLater();
  }
  function readFragment() {
    const wanted = new URLSearchParams(location.hash.slice(1));
    const number = (name) => parseFloat(wanted.get(name));
    if (bend && number("bend") >= 1) bend.value = number("bend");
    const i = number("case") - 1;
    if (Number.isFinite(number("t"))) t = number("t");
    if (number("from") < number("to")) zoom = [number("from"), number("to")];
    choose(cases[i] ? i : index, number("with") - 1);
  }

  // A click on a row of the table.
  const table = $("cases");
  if (table) table.addEventListener("click", (event) => {
    const row = event.target.closest("[data-case]");
    if (!row) return;
    event.preventDefault();
    choose(Number(row.dataset.case) - 1);
    remember();
  });
  if (chooser) {
    chooser.addEventListener("change", () => { choose(Number(chooser.value)); remember(); });
    compared.addEventListener("change", () => { choose(index, Number(compared.value)); remember(); });
  }
  slider.addEventListener("input", () => {
    const [low, high] = shownSpan();
    seek(low + (slider.value / 2000) * (high - low));
  });
  slider.addEventListener("change", remember);
  $("closer").addEventListener("click", () => scaleBy(0.5));
  $("wider").addEventListener("click", () => scaleBy(2));
  $("reset").addEventListener("click", () => zoomTo(null));
  $("charts").addEventListener("mouseup", remember);
  if (stage) {
    play.addEventListener("click", toggle);
    bend.addEventListener("input", draw);
    bend.addEventListener("change", remember);
    stage.addEventListener("keydown", (event) => {
      const steps = { ArrowRight: 1, ArrowUp: 1, ArrowLeft: -1, ArrowDown: -1 };
      const [low, high] = shownSpan();
      if (event.key === " ") toggle();
      else if (event.key === "Home") seek(low);
      else if (event.key === "End") seek(high);
      else if (steps[event.key]) seek(t + 0.01 * (high - low) * steps[event.key]);
      else return;
      event.preventDefault();
    });
  }
  window.addEventListener("hashchange", readFragment);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => {
    readColours();
    charts.forEach(({ plot }) => plot.redraw(false));
    drawLater();
  });

  document.body.classList.add("live");
  $("explore").hidden = false;
  const stills = $("stills");
  if (stills) {
    stills.open = false;
    window.addEventListener("beforeprint", () => { stills.open = true; });
  }
  readColours();
  t = span(current())[0];
  readFragment();
  new ResizeObserver(resize).observe($("explore"));
})();
