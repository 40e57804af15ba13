// Uses a page as a person would, and tells the test what it saw.
(async () => {
  const seen = {}, $ = (id) => document.getElementById(id);
  const wait = (ms) => new Promise((done) => setTimeout(done, ms));
  // uPlot takes no drag whose events have no movement.
  const mouse = (target, type, x, y, more = {}) => target.dispatchEvent(
    new MouseEvent(type, { bubbles: true, cancelable: true, view: window, clientX: x, clientY: y, movementX: 1, ...more }));
  const overs = () => [...document.querySelectorAll(".u-over")];
  const cursors = () => [...document.querySelectorAll(".u-cursor-x")].map((c) => c.style.transform.match(/-?[\d.]+/)[0]);
  const values = () => [...document.querySelectorAll(".chart")].map((c) => [
    c.querySelector("h3").textContent, [...c.querySelectorAll("b")].map((b) => b.textContent.replace("\u2212", "-"))]);
  const time = () => parseFloat($("time").value.replace("\u2212", "-"));
  const picture = () => ($("stage") ? $("stage").toDataURL() : "");

  // Contrast of all text with what is behind it; large text would need less.
  function contrasts() {
    const channels = (colour) => (colour.match(/[\d.]+/g) || []).map(Number);
    const light = ([r, g, b]) => [r, g, b].map((c) => c / 255).map((c) => (c <= 0.03928 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4))
      .reduce((sum, c, i) => sum + c * [0.2126, 0.7152, 0.0722][i], 0);
    let least = [99, ""];
    for (const element of document.querySelectorAll("main *")) {
      if (element.closest("svg, option, [hidden]") || element.disabled || !element.getClientRects().length) continue;
      if (![...element.childNodes].some((n) => n.nodeType === 3 && n.textContent.trim())) continue;
      let behind = element, ground = [];
      while (behind && !(ground.length === 3 || ground[3] > 0)) { ground = channels(getComputedStyle(behind).backgroundColor); behind = behind.parentElement; }
      const [a, b] = [light(channels(getComputedStyle(element).color)), light(ground)];
      const ratio = (Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05);
      if (ratio < least[0]) least = [ratio, element.outerHTML.slice(0, 80)];
    }
    return least;
  }

  try {
    await wait(200);
    seen.width = innerWidth;
    seen.scroll = document.documentElement.scrollWidth;
    seen.dark = matchMedia("(prefers-color-scheme: dark)").matches;
    seen.contrast = contrasts();
    if (overs().length) {
      // The pointer on the last chart.
      let before = picture(), chart = overs()[overs().length - 1], box = chart.getBoundingClientRect();
      mouse(chart, "mouseenter", box.left + 0.3 * box.width, box.top + 20);
      mouse(chart, "mousemove", box.left + 0.3 * box.width, box.top + 20);
      await wait(100);
      seen.hover = { t: time(), cursors: cursors(), values: values(), moved: picture() !== before };
      // A drag.
      const at = (share) => box.left + share * box.width;
      mouse(chart, "mousemove", at(0.1), box.top + 20);
      mouse(chart, "mousedown", at(0.1), box.top + 20, { button: 0 });
      for (const share of [0.15, 0.2, 0.3]) mouse(chart, "mousemove", at(share), box.top + 20);
      mouse(document, "mouseup", at(0.3), box.top + 20, { button: 0 });
      await wait(100);
      seen.zoomed = location.hash;
      $("reset").click();
      await wait(100);
      seen.reset = location.hash;
    }
    const row = document.querySelector("tr[data-case='6'] td:nth-child(3)");
    if (row) {
      row.click();
      await wait(100);
      seen.row = { hash: location.hash, chosen: document.querySelector("tr.chosen").dataset.case, select: $("case").value, values: values() };
    }
    if ($("play")) {
      const from = time();
      $("play").click();
      for (let i = 0; i < 20; i++) { await new Promise(requestAnimationFrame); await wait(20); }
      $("play").click();
      await wait(100);
      seen.played = { from, to: time(), cursors: cursors(), label: $("stage").getAttribute("aria-label") };
    }
    seen.done = true;
  } catch (error) {
    seen.error = String(error.stack || error);
  }
  await fetch("/seen", { method: "POST", body: JSON.stringify(seen) });
})();
