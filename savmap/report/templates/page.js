"use strict";
(() => {
  const all = (what, within = document) => [...within.querySelectorAll(what)];
  const byId = (id) => document.getElementById(id);
  all(".tools").forEach((own) => { own.hidden = false; });

  /* Tables: sorted by a click on a heading, filtered by words and by a mark. */
  const sortKey = (row, column) => {
    const cell = row.cells[column];
    return cell.dataset.v === undefined ? cell.textContent.trim() : Number(cell.dataset.v);
  };
  const compare = (a, b) => (typeof a === "number" && typeof b === "number" ? a - b
    : typeof a === "number" ? -1 : typeof b === "number" ? 1 : a.localeCompare(b, "en", { numeric: true }));
  const sort = (table, head, column) => {
    const down = head.getAttribute("aria-sort") === "ascending";
    all("thead th", table).forEach((own) => own.removeAttribute("aria-sort"));
    head.setAttribute("aria-sort", down ? "descending" : "ascending");
    const keyed = [...table.tBodies[0].rows].map((row) => [sortKey(row, column), row]);
    keyed.sort((a, b) => (down ? -1 : 1) * compare(a[0], b[0]));
    table.tBodies[0].append(...keyed.map((own) => own[1]));
  };
  all("table.sortable").forEach((table) => {
    if (table.tBodies[0].rows.length < 3) return;
    all("thead th", table).forEach((head, column) => {
      const button = document.createElement("button");
      button.type = "button";
      button.textContent = head.textContent;
      head.replaceChildren(button);
      button.addEventListener("click", () => sort(table, head, column));
    });
  });
  const filter = (id) => {
    const box = byId(id), find = box.querySelector("input[data-find]"), only = box.querySelector("input[data-marked]");
    const words = find.value.toLowerCase().trim(), exact = find.dataset.exact;
    const rows = all("tbody tr", box);
    rows.forEach((row) => {
      const found = exact !== undefined && find.value === exact ? [...row.cells].some((cell) => cell.textContent === exact)
        : row.textContent.toLowerCase().includes(words);
      row.hidden = !found || Boolean(only && only.checked && !row.className);
    });
    const shown = rows.filter((row) => !row.hidden).length;
    box.querySelector("output").textContent = shown < rows.length ? `${shown} of ${rows.length}` : "";
  };
  all("input[data-find]").forEach((own) => own.addEventListener("input", () => filter(own.dataset.find)));
  all("input[data-marked]").forEach((own) => own.addEventListener("change", () => filter(own.dataset.marked)));
  all("a[data-only]").forEach((link) => link.addEventListener("click", () => {
    const find = byId("references-table").querySelector("input[data-find]");
    if (!find) return;
    find.value = find.dataset.exact = link.dataset.only;
    filter("references-table");
  }));

  /* Words under the pointer: titles of shapes, taken out of the browser's own slow tips. */
  const tip = byId("tip");
  const hintOf = (shape) => {
    const title = shape.querySelector(":scope > title");
    if (title) { shape.dataset.hint = title.textContent; title.remove(); }
    return shape.dataset.hint;
  };
  const pointed = (x, y) => {
    for (const [dx, dy] of [[0, 0], [-4, 0], [4, 0], [0, -4], [0, 4]]) {
      const shape = document.elementFromPoint(x + dx, y + dy);
      if (shape && shape.tagName === "path" && hintOf(shape)) return shape;
    }
    return null;
  };
  const tell = (event) => {
    const shape = pointed(event.clientX, event.clientY);
    tip.hidden = !shape;
    if (!shape) return;
    if (tip.textContent !== shape.dataset.hint) tip.textContent = shape.dataset.hint;
    const { width, height } = tip.getBoundingClientRect();
    const below = event.clientY + 18 + height < innerHeight;
    tip.style.left = `${Math.max(4, Math.min(event.clientX + 12, innerWidth - width - 8))}px`;
    tip.style.top = `${below ? event.clientY + 18 : event.clientY - height - 10}px`;
  };
  const hush = () => { tip.hidden = true; };
  addEventListener("scroll", hush, { passive: true });

  /* Labels keep their size; of those that would lie on one another the first stays. */
  const declutter = (svg) => {
    const texts = all(".labels text", svg), taken = [];
    texts.forEach((own) => own.classList.remove("hidden"));
    const boxes = texts.map((own) => own.getBoundingClientRect());
    const whole = svg.getBoundingClientRect();
    texts.map((own, k) => [own, boxes[k]]).sort((a, b) => a[0].classList.contains("tick") - b[0].classList.contains("tick"))
      .forEach(([own, box]) => {
        const inside = box.right > whole.left && box.left < whole.right && box.bottom > whole.top && box.top < whole.bottom;
        const clash = taken.some((other) => box.left < other.right + 2 && box.right > other.left - 2 && box.top < other.bottom - 1 && box.bottom > other.top + 1);
        if (inside && !clash) taken.push(box);
        own.classList.toggle("hidden", clash);
      });
  };

  /* Pictures in metres: the wheel with Ctrl, two fingers, a drag, keys or buttons move them. */
  const zoomable = (svg) => {
    const full = svg.viewBox.baseVal;
    const whole = { x: full.x, y: full.y, w: full.width, h: full.height };
    const [across, along, flip] = svg.dataset.axes.split(",");
    const readout = svg.closest("figure").querySelector(".readout");
    let view = whole;
    const show = () => {
      svg.setAttribute("viewBox", `${view.x} ${view.y} ${view.w} ${view.h}`);
      const unit = Math.max(view.w / svg.clientWidth, view.h / svg.clientHeight);
      svg.style.setProperty("--u", unit);
      svg.classList.add("movable");
      declutter(svg);
    };
    const fit = (box) => {
      const ratio = svg.clientWidth / svg.clientHeight;
      const w = Math.max(box.w, box.h * ratio), h = w / ratio;
      return { x: box.x + (box.w - w) / 2, y: box.y + (box.h - h) / 2, w, h };
    };
    const start = () => {
      const own = fit(whole);
      if (whole.h < 0.45 * own.h && innerWidth < 700) {
        const w = Math.max(whole.h / 0.75 * own.w / own.h, whole.w / 3), h = w * own.h / own.w;
        return { x: whole.x, y: whole.y - (h - whole.h) / 2, w, h };
      }
      return own;
    };
    const at = (x, y) => {
      const box = svg.getBoundingClientRect();
      return { x: view.x + view.w * (x - box.left) / box.width, y: view.y + view.h * (y - box.top) / box.height };
    };
    const keep = () => {
      view.x = Math.min(Math.max(view.x, whole.x - view.w / 2), whole.x + whole.w - view.w / 2);
      view.y = Math.min(Math.max(view.y, whole.y - view.h / 2), whole.y + whole.h - view.h / 2);
    };
    const zoom = (factor, where) => {
      const largest = fit(whole).w * 1.2;
      const by = Math.min(Math.max(view.w * factor, 400), largest) / view.w;
      const centre = where || { x: view.x + view.w / 2, y: view.y + view.h / 2 };
      view = { x: centre.x + (view.x - centre.x) * by, y: centre.y + (view.y - centre.y) * by, w: view.w * by, h: view.h * by };
      keep(); show();
    };
    const move = (dx, dy) => { view = { ...view, x: view.x + dx, y: view.y + dy }; keep(); show(); };
    const reset = () => { view = fit(whole); show(); };
    const fingers = new Map();
    let dragged = 0;
    svg.addEventListener("pointerdown", (event) => {
      fingers.set(event.pointerId, event);
      dragged = 0;
    });
    svg.addEventListener("pointermove", (event) => {
      const before = fingers.get(event.pointerId);
      const place = at(event.clientX, event.clientY);
      readout.textContent = `${across} ${(place.x / 1000).toFixed(2)} m, ${along} ${(Number(flip) * place.y / 1000).toFixed(2)} m`;
      if (!before) { tell(event); return; }
      const dx = event.clientX - before.clientX, dy = event.clientY - before.clientY;
      dragged += Math.abs(dx) + Math.abs(dy);
      if (dragged > 4 && !svg.classList.contains("moving")) { svg.classList.add("moving"); svg.setPointerCapture(event.pointerId); hush(); }
      if (fingers.size === 2) {
        const other = [...fingers.values()].find((own) => own.pointerId !== event.pointerId);
        const apart = (own) => Math.hypot(own.clientX - other.clientX, own.clientY - other.clientY);
        if (apart(event) > 10) zoom(apart(before) / apart(event), at((event.clientX + other.clientX) / 2, (event.clientY + other.clientY) / 2));
      } else if (dragged > 4) {
        move(-dx * view.w / svg.clientWidth, -dy * view.h / svg.clientHeight);
      }
      fingers.set(event.pointerId, event);
    });
    const lift = (event) => { fingers.delete(event.pointerId); svg.classList.remove("moving"); };
    svg.addEventListener("pointerup", (event) => { lift(event); if (dragged <= 4) tell(event); });
    svg.addEventListener("pointercancel", lift);
    svg.addEventListener("pointerleave", (event) => { hush(); readout.textContent = ""; if (!svg.classList.contains("moving")) lift(event); });
    svg.addEventListener("click", (event) => { if (dragged > 4) event.preventDefault(); }, true);
    svg.addEventListener("dragstart", (event) => event.preventDefault());
    svg.addEventListener("wheel", (event) => {
      if (!event.ctrlKey && !event.metaKey && document.activeElement !== svg) return;
      event.preventDefault();
      zoom(Math.exp(event.deltaY * 0.0016), at(event.clientX, event.clientY));
    }, { passive: false });
    svg.addEventListener("keydown", (event) => {
      if (event.target !== svg || event.ctrlKey || event.metaKey || event.altKey) return;
      const step = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key];
      if (step) move(step[0] * view.w / 8, step[1] * view.h / 8);
      else if (event.key === "+" || event.key === "=") zoom(0.7);
      else if (event.key === "-") zoom(1 / 0.7);
      else if (event.key === "0") reset();
      else return;
      event.preventDefault();
    });
    all("button[data-zoom]", svg.closest("figure")).forEach((button) => button.addEventListener("click", () => {
      if (button.dataset.zoom === "all") reset();
      else zoom(button.dataset.zoom === "in" ? 0.6 : 1 / 0.6);
    }));
    addEventListener("beforeprint", () => { view = whole; svg.setAttribute("viewBox", `${view.x} ${view.y} ${view.w} ${view.h}`); svg.style.setProperty("--u", view.w / 700); });
    addEventListener("afterprint", reset);
    new ResizeObserver(() => {
      if (!svg.clientWidth) return;
      view = view === whole ? start() : { ...view, h: view.w * svg.clientHeight / svg.clientWidth };
      show();
    }).observe(svg);
  };
  all("figure > svg").forEach((svg) => {
    const title = svg.querySelector(":scope > title");
    svg.setAttribute("aria-label", title.textContent);
    svg.removeAttribute("aria-labelledby");
    title.remove();
  });
  const near = new IntersectionObserver((entries) => entries.forEach((entry) => {
    if (!entry.isIntersecting) return;
    near.unobserve(entry.target);
    zoomable(entry.target);
  }), { rootMargin: "300px" });
  all("svg.zoom").forEach((svg) => near.observe(svg));
  all(".plot > svg").forEach((svg) => {
    const width = svg.viewBox.baseVal.width;
    new ResizeObserver(() => { if (svg.clientWidth) svg.style.setProperty("--u", Math.max(1, width / svg.clientWidth)); }).observe(svg);
    svg.addEventListener("pointermove", tell);
    svg.addEventListener("pointerleave", hush);
  });
  all("details.elements").forEach((own) => own.addEventListener("toggle", () => {
    if (!own.open || own.querySelector("ul")) return;
    const list = document.createElement("ul");
    const words = new Set(all(`#${own.dataset.of} svg.zoom g:not(.camera) > path`).map(hintOf).filter(Boolean));
    words.forEach((text) => { const item = document.createElement("li"); item.textContent = text; list.append(item); });
    own.append(list);
  }));
})();
