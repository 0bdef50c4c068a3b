// Errors of the model as given and as it is now: over all trials of a use, and per condition.
import { element, percent, shown } from "./format.js";

const USES = [
  ["held_out", "Held out"],
  ["train", "Training"],
  ["mvc", "Maximal contractions"],
];

export class Summary {
  constructor() {
    this.cards = element("div", { class: "live-cards" });
    this.body = element("tbody");
    const head = ["Trials", "Condition", "As given", "Now", "RMS error now"].map((text, i) =>
      element("th", { scope: "col", class: i > 1 ? "n" : "" }, text),
    );
    const table = element(
      "table",
      { class: "conditions" },
      element("thead", {}, element("tr", {}, ...head)),
      this.body,
    );
    this.conditions = element(
      "details",
      {},
      element("summary", {}, "Error of every condition"),
      element("div", { class: "scroll" }, table),
    );
  }

  show(given, now) {
    const uses = USES.filter(([use]) => now.errors[use]);
    this.cards.replaceChildren(...uses.map(([use, title]) => card(title, given.errors[use], now.errors[use], use)));
    this.body.replaceChildren(
      ...uses.flatMap(([use, title]) =>
        now.errors[use].conditions.map(([name, errors], i) => {
          const before = given.errors[use].conditions[i][1];
          return row(i ? "" : title, name, before, errors);
        }),
      ),
    );
  }
}

function card(title, before, now, use) {
  const differs = percent(now.nrmse) !== percent(before.nrmse);
  const tone = !differs ? "" : now.nrmse < before.nrmse ? "good" : "bad";
  const bar = (part, className) => {
    const made = element("span", { class: `live-bar ${className}` });
    made.style.setProperty("width", `${Math.min(100 * part * 3, 100)}%`);
    return made;
  };
  const made = element(
    "div",
    { class: `card ${tone}` },
    element("p", { class: "label" }, `${title}, ${now.trials} ${now.trials === 1 ? "trial" : "trials"}`),
    element(
      "p",
      { class: "value" },
      element("span", { class: "was" }, percent(before.nrmse)),
      element("span", { class: "arrow" }, "→"),
      element("span", { class: "now" }, percent(now.nrmse)),
    ),
    element("div", { class: "live-bars" }, bar(before.nrmse, "before"), bar(now.nrmse, "after")),
  );
  made.dataset.use = use;
  made.dataset.nrmse = now.nrmse;
  return made;
}

function row(use, name, before, now) {
  return element(
    "tr",
    {},
    element("th", { scope: "row" }, use),
    element("td", {}, name),
    element("td", { class: "n was" }, percent(before.nrmse)),
    element("td", { class: "n strong" }, percent(now.nrmse)),
    element("td", { class: "n" }, `${shown(now.rmse_n_m)}\u202fN·m`),
  );
}
