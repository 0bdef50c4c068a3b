"use strict";
// The page of carpus live: shows what the server tells, and asks it for steps.
(() => {
  const id = (name) => document.getElementById(name);
  const make = (tag, text, name) => {
    const element = document.createElement(tag);
    if (text !== undefined) element.textContent = text;
    if (name) element.className = name;
    return element;
  };

  // The token stays out of the history; the browser has it as a cookie.
  if (location.search) history.replaceState(null, "", location.pathname);

  let state = null;
  /** The step that is looked at; 0: none. It follows the current one until another is opened. */
  let looked = 0;
  const chosen = [];

  /** Sets a text that is read out when it changes, and only then. */
  const tell = (element, text) => {
    if (element.textContent !== text) element.textContent = text;
  };

  /** Whether what is said is that the server is gone: then it goes when the server is there again. */
  let isLost = false;
  const say = (text, lost = false) => {
    id("alert").textContent = text ?? "";
    id("alert").hidden = !text;
    isLost = lost;
  };

  const ask = async (path, body) => {
    say();
    try {
      const answer = await fetch(path, {
        method: "POST",
        headers: { "Content-Type": "application/json" },
        body: JSON.stringify(body),
      });
      if (answer.ok) return true;
      const text = await answer.text();
      let told = text;
      try {
        told = JSON.parse(text).error ?? text;
      } catch {
        // Not of this page's own answers: shown as it is.
      }
      say(told);
    } catch {
      say("The server does not answer. Is carpus live still running?", true);
    }
    return false;
  };

  const fill = (select, options) => {
    const before = select.value;
    const same = select.options.length === options.length && options.every(([value, text], i) => select.options[i].value === value && select.options[i].textContent === text);
    if (same) return;
    select.replaceChildren(...options.map(([value, text]) => Object.assign(make("option", text), { value })));
    if (options.some(([value]) => value === before)) select.value = before;
  };

  // The study.

  const finding = (found) => {
    const item = make("li", undefined, found.level);
    item.append(make("span", found.level, `level ${found.level}`), ` ${found.subject}: ${found.text}`);
    if (found.also) item.append(` (and ${found.also} more)`);
    if (found.place) item.append(make("span", found.place, "place"));
    if (found.remedy) item.append(make("span", found.remedy, "remedy"));
    return item;
  };

  const showStudy = ({ name, check, fault, is_checking: checking, checks }) => {
    id("study").textContent = name;
    document.title = name ? `${name} – carpus live` : "carpus live";
    const level = check ? check.level : fault ? "red" : "";
    const light = id("light");
    light.className = `light ${level}`;
    tell(light, checking ? "checking" : level ? `study: ${level}` : "not checked");
    const findings = check?.findings ?? [];
    const open = findings.filter((f) => f.level !== "green");
    const green = findings.filter((f) => f.level === "green");
    id("findings").replaceChildren(...open.map(finding));
    id("green").hidden = !green.length;
    id("green").querySelector("summary").textContent = `${green.length} in order`;
    id("green").querySelector("ul").replaceChildren(...green.map(finding));
    const trials = (check?.conditions ?? []).reduce((n, c) => n + c.fitted + c.held_out + c.mvc, 0);
    const about = fault ?? (trials ? `${trials} trials; checked anew when a file changes.` : "Checked anew when a file changes.");
    id("check-state").textContent = checking ? "The files are being checked." : about;
    document.body.dataset.checks = checking ? "" : String(checks);
  };

  // The next step.

  const showForm = () => {
    const command = id("command").value;
    for (const part of document.querySelectorAll("[data-for]")) part.hidden = !part.dataset.for.split(" ").includes(command);
    const names = state?.study.participants ?? [];
    const one = command === "effect_remove" || (id("from").value === "current" && !id("from").closest("label").hidden);
    fill(id("participant"), [...(one || names.length === 1 ? [] : [["", "all"]]), ...names.map((name) => [name, name])]);
    const now = state?.ledger.steps[state.ledger.current - 1];
    const models = Object.keys(now?.models ?? {});
    id("from").querySelector("[value=current]").disabled = !models.length;
    if (!models.length && id("from").value) id("from").value = "";
    const known = state?.study.effects ?? [];
    fill(id("effect"), [["", "an effect"], ...known.filter((e) => !chosen.includes(e.id)).map((e) => [e.id, e.name])]);
    id("chosen").replaceChildren(
      ...chosen.map((effect, at) => {
        const name = known.find((e) => e.id === effect)?.name ?? effect;
        const item = make("li", `${name} `);
        const away = make("button", "take away");
        away.type = "button";
        away.setAttribute("aria-label", `take ${name} away`);
        away.addEventListener("click", () => {
          chosen.splice(at, 1);
          showForm();
          id("effect").focus();
        });
        item.append(away);
        return item;
      }),
    );
    if (command === "effect_remove") showSteps(now);
  };

  /** Whether a step, or the one whose folder it went on in, added effects. */
  const hasEffects = (step) => Boolean(step) && (step.writer === "effect" || hasEffects(state.ledger.steps[step.copy_of - 1]));

  /** Steps of the participant's own ledger of effects. */
  const showSteps = async (now) => {
    const participant = id("participant").value;
    let options = [["", "one step back"]];
    if (hasEffects(now) && participant) {
      try {
        const answer = await fetch(`files/${encoded(`${now.folder}/${participant}/ledger.json`)}`);
        const ledger = answer.ok ? await answer.json() : null;
        options = options.concat((ledger?.steps ?? []).map((s, i) => [String(i), `${i}: ${s.label}${i === ledger.current ? " (now)" : ""}`]));
      } catch {
        // Without a ledger there is nothing to go back in: the server says so.
      }
    }
    fill(id("to"), options);
  };

  const encoded = (path) => path.split("/").map(encodeURIComponent).join("/");

  const showJob = (job) => {
    id("job").hidden = !job;
    id("run").disabled = Boolean(job);
    if (!job) return;
    id("job-label").textContent = state.ledger.steps[job.step - 1]?.label ?? "";
    tell(id("job-what"), job.is_stopping ? "stopping" : job.at.what);
    const bar = id("job-bar");
    if (job.at.steps) {
      bar.max = job.at.steps;
      bar.value = job.at.done;
    } else bar.removeAttribute("value");
    id("stop").disabled = job.is_stopping;
    id("job-messages").hidden = !job.messages.length;
    id("job-messages").textContent = job.messages.join("\n");
  };

  id("form").addEventListener("submit", async (event) => {
    event.preventDefault();
    const command = id("command").value;
    const asked = { command };
    const has = (element) => !element.closest("[data-for]").hidden;
    // A command for the only participant is one for all.
    const only = state?.study.participants.length === 1 && command !== "effect_remove" && !(has(id("from")) && id("from").value);
    if (id("participant").value && !only) asked.participants = [id("participant").value];
    if (has(id("from")) && id("from").value) asked.from_current = true;
    if (has(id("no-intervals")) && id("no-intervals").checked) asked.no_intervals = true;
    if (has(id("effect")) && chosen.length) asked.effects = [...chosen];
    if (has(id("i-choose")) && id("i-choose").checked) asked.i_choose = true;
    if (has(id("to")) && id("to").value) asked.to = Number(id("to").value);
    const steps = id("steps").value.split(",").map((name) => name.trim()).filter(Boolean);
    if (has(id("steps")) && steps.length) asked.steps = steps;
    await ask("run", asked);
  });
  for (const name of ["command", "participant", "from"]) id(name).addEventListener("change", showForm);
  id("effect").addEventListener("change", () => {
    if (id("effect").value) chosen.push(id("effect").value);
    id("effect").value = "";
    showForm();
  });
  id("stop").addEventListener("click", () => ask("stop", {}));

  // The ledger.

  const outcomes = { running: "under way", done: "", partly: "not all could be done", failed: "failed", cancelled: "stopped" };

  const showLedger = ({ steps, current }) => {
    const given = { id: 0, label: "The study as it is", outcome: "done", parent: null };
    const items = [given, ...steps].map((step) => {
      const item = make("li");
      item.dataset.step = step.id;
      item.dataset.outcome = step.outcome;
      const what = make("span", step.id ? `${step.id} ${step.label}` : step.label, "what");
      const notes = [outcomes[step.outcome], step.parent !== null && step.parent !== step.id - 1 ? `after ${step.parent || "the study as it is"}` : ""];
      item.append(what, make("span", notes.filter(Boolean).join("; "), "note"));
      if (step.id === current) item.setAttribute("aria-current", "step");
      item.classList.toggle("looked", step.id > 0 && step.id === looked);
      const acts = make("span", undefined, "acts");
      const act = (name, label, run) => {
        const button = make("button", name);
        button.type = "button";
        button.setAttribute("aria-label", label);
        button.addEventListener("click", run);
        acts.append(button);
      };
      if (step.id && step.outcome !== "running") act("Look", `look at step ${step.id}`, () => look(step.id));
      if (step.id !== current && ["done", "partly"].includes(step.outcome)) {
        act("Go here", step.id ? `make step ${step.id} the current one` : "make the study as it is the current one", () => ask("go", { step: step.id }));
      }
      item.append(acts);
      return item;
    });
    // Whoever goes through the list by the keyboard stays where they are.
    const focused = id("ledger").contains(document.activeElement) ? document.activeElement.getAttribute("aria-label") : null;
    id("ledger").replaceChildren(...items);
    if (focused) [...id("ledger").querySelectorAll("button")].find((b) => b.getAttribute("aria-label") === focused)?.focus();
  };

  // The result.

  const look = (step) => {
    looked = step;
    showLedger(state.ledger);
    showResult();
  };

  /** The step whose words are shown, so that whoever folds them is let be. */
  let told = 0;
  const showResult = () => {
    const step = state.ledger.steps[looked - 1];
    id("result").hidden = !step;
    id("nothing").hidden = Boolean(step);
    id("result-title").textContent = step ? `${step.id} ${step.label}` : "Result";
    const pages = step?.pages ?? [];
    if (step) {
      fill(id("page"), pages.map((page) => [page, page.slice(step.folder.length + 1)]));
      id("commands").textContent = step.commands.join("\n");
      id("said").textContent = [...step.messages, step.said].join("\n").trim();
      id("said").hidden = !id("said").textContent;
      if (told !== looked) id("told").open = !pages.length;
      told = looked;
      const models = Object.entries(step.models).flatMap(([, model]) => [model.model, model.effects]).filter(Boolean);
      id("models").replaceChildren(
        ...models.flatMap((path) => {
          const link = make("a", path);
          link.href = `files/${encoded(path)}`;
          link.download = "";
          return [" ", link];
        }),
      );
      if (models.length) id("models").prepend("Models after this step:");
    }
    showPage();
  };

  const showPage = () => {
    const page = id("page").value;
    const frame = id("report");
    const shown = looked && page ? `files/${encoded(page)}` : "";
    frame.hidden = !shown;
    id("alone").hidden = !shown;
    id("page").closest("label").hidden = !shown;
    if (!shown) {
      frame.removeAttribute("src");
      return;
    }
    id("alone").href = shown;
    if (frame.getAttribute("src") !== shown) frame.src = shown;
  };
  id("page").addEventListener("change", showPage);

  const show = (now) => {
    const before = state;
    state = now;
    showStudy(now.study);
    showJob(now.job);
    const running = now.job?.step;
    if (!before || before.ledger.current !== now.ledger.current) looked = now.ledger.current;
    // What failed is shown, too: it says why.
    const ended = before?.job && !now.job ? before.job.step : null;
    if (ended && now.ledger.steps[ended - 1]?.outcome !== "done") looked = ended;
    if (looked === running) looked = now.ledger.current;
    showLedger(now.ledger);
    showForm();
    showResult();
    document.body.dataset.ready = "true";
  };

  id("theme").addEventListener("click", () => {
    const root = document.documentElement;
    const dark = root.dataset.theme ? root.dataset.theme === "dark" : matchMedia("(prefers-color-scheme: dark)").matches;
    root.dataset.theme = dark ? "light" : "dark";
  });

  const events = new EventSource("events");
  events.addEventListener("state", (event) => {
    if (isLost) say();
    show(JSON.parse(event.data));
  });
  events.addEventListener("progress", (event) => {
    if (!state) return;
    state.job = JSON.parse(event.data);
    showJob(state.job);
  });
  events.addEventListener("error", () => {
    if (events.readyState === EventSource.CLOSED) say("The server has ended. Start carpus live again to go on.", true);
    else say("The server does not answer. Is carpus live still running?", true);
  });
})();
