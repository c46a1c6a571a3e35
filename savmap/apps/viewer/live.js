"use strict";
const ARROWS = { left: "\u2190", right: "\u2192", back: "\u21e4", on: "\u21e5", "": "" };
const WALK_ON = { severity: "good", text: "Walk on.", arrow: "on" };
const ended = (severity, text) => ({ severity, text, arrow: "" });
const ENDS = {
  stopped: () => ended("good", "The walk has ended. What is mapped is provisional."),
  mapping: () => ended("good", "The walk has ended. All that was recorded is being mapped."),
  mapped: (banner) =>
    banner ? ended("attention", `Done: all is mapped, but ${banner}.`) : ended("good", "Done: all is mapped, and nothing speaks against it."),
  failed: (problem) => ended("stop", `The walk has ended, and no final map was made: ${problem}`),
};
const byId = (id) => document.getElementById(id);

function showState(state) {
  const walking = state.status === "walking";
  const first = walking ? (state.advice[0] ?? WALK_ON) : ENDS[state.status](state.problem);
  byId("bar").className = first.severity;
  byId("text").textContent = first.text;
  byId("arrow").textContent = ARROWS[first.arrow];
  const frames = state.status === "mapped" ? state.frames : `${state.measured} of ${state.frames}`;
  byId("figures").textContent = `${state.footage_s.toFixed(0)} s · ${frames} frames · ${state.elements} elements`;
  const missing = state.problem ? `No map yet: ${state.problem}` : "No map yet.";
  byId("problem").textContent = walking && !state.maps ? missing : "";
}

function showPlan(plan) {
  const svg = byId("plan");
  svg.replaceChildren();
  if (!plan.elements.length) return;
  const xs = plan.elements.flatMap((element) => element.edges.flatMap((edge) => [edge[0], edge[2]]));
  const ys = plan.elements.flatMap((element) => element.edges.flatMap((edge) => [edge[1], edge[3]]));
  const [left, right, low, high] = [Math.min(...xs), Math.max(...xs), Math.min(...ys), Math.max(...ys)];
  svg.setAttribute("viewBox", `${left - 0.3} ${-high - 0.3} ${right - left + 0.6} ${high - low + 0.6}`);
  for (const element of plan.elements) {
    const path = document.createElementNS("http://www.w3.org/2000/svg", "path");
    path.setAttribute("d", element.edges.map((e) => `M${e[0]} ${-e[1]}L${e[2]} ${-e[3]}`).join(""));
    const sure = element.sigma_mm < 5 ? "fine" : element.sigma_mm < 15 ? "fair" : "poor";
    path.setAttribute("class", element.probability < 0.99 ? `${sure} uncertain` : sure);
    const title = document.createElementNS("http://www.w3.org/2000/svg", "title");
    title.textContent = `${element.id}: ${element.sigma_mm.toFixed(1)} mm`;
    path.append(title);
    svg.append(path);
  }
}

const events = new EventSource("events");
events.addEventListener("state", (event) => showState(JSON.parse(event.data)));
events.addEventListener("map", (event) => {
  showPlan(JSON.parse(event.data));
  byId("map").src = "view.html";
});
