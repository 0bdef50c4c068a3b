// Opens a report in Chromium as a person would, does what a plan says, and tells what was seen.
//
//   node browser.mjs REPORT.html PLAN.json SEEN.json
//
// A plan: { "fields": [[muscle, property, value]], "effect": id or null, "values": [..],
// "model": label or null, "last": the last of its effects or null, "fit": true or false,
// "motion": true or false, "screenshots": folder or null }.
import { readFileSync, writeFileSync } from "node:fs";
import path from "node:path";
import { looks, withPage } from "./chromium.mjs";

const [report, planFile, seenFile] = process.argv.slice(2);
const plan = JSON.parse(readFileSync(planFile, "utf8"));
const seen = await withPage(report, { colorScheme: plan.theme ?? "light" }, async (page, seen, downloads) => {
  await page.waitForFunction(() => document.getElementById("live").dataset.renewed, null, looks);
  const data = () => page.evaluate(() => ({ ...document.getElementById("live").dataset }));
  seen.startedMs = Number((await data()).started);

  const renewed = async (act) => {
    const before = (await data()).renewed;
    await act();
    await page.waitForFunction((b) => document.getElementById("live").dataset.renewed !== b, before, looks);
    const { changed, renewed: now } = await data();
    return Number(now) - Number(changed);
  };
  const settled = () =>
    page.waitForFunction(() => document.getElementById("live").dataset.settled === "true", null, looks);
  const errors = async () => {
    await settled();
    return page.evaluate(() =>
      Object.fromEntries(
        [...document.querySelectorAll(".live-cards .card")].map((c) => [c.dataset.use, Number(c.dataset.nrmse)]),
      ),
    );
  };
  /** Errors of every step, training and held out, as the waterfall draws them. */
  const waterfall = async () => {
    await settled();
    const number = (text) => (text === "" ? null : Number(text));
    const steps = await page.evaluate(() =>
      [...document.querySelectorAll(".live-step")].map((g) => [g.dataset.train, g.dataset.held]),
    );
    return steps.map((step) => step.map(number));
  };
  const download = async (name, count = 1) => {
    await settled();
    await downloads(() => page.getByRole("button", { name, exact: true }).click(), count);
  };
  const shoot = async (name) => {
    if (plan.screenshots) await page.screenshot({ path: path.join(plan.screenshots, `${name}.png`) });
  };
  const live = page.locator("#live");
  await live.scrollIntoViewIfNeeded();
  await page.evaluate(() => document.getElementById("live").scrollIntoView());

  await renewed(() => page.getByRole("button", { name: "As given", exact: true }).click());
  seen.asGiven = await errors();
  await shoot("given");
  seen.renewedMs = [];
  for (const [muscle, property, value] of plan.fields) {
    const field = live.locator("fieldset").filter({ hasText: muscle }).locator(".field").nth(property);
    seen.renewedMs.push(
      await renewed(async () => {
        await field.fill(String(value));
        await field.press("Enter");
      }),
    );
  }
  // A step of a slider by the keyboard, and back: what it takes until all curves are drawn.
  const slider = live.locator("fieldset input[type=range]").first();
  const value = await live.locator("fieldset .field").first().inputValue();
  for (let i = 0; i < 10; i += 1) seen.renewedMs.push(await renewed(() => slider.press("ArrowRight")));
  const field = live.locator("fieldset .field").first();
  await renewed(async () => {
    await field.fill(value);
    await field.press("Enter");
  });
  seen.dragged = await errors();
  await shoot("dragged");
  await download("Save all curves");
  await download("Save parameters");
  await download("Save model.osim");

  if (plan.effect) {
    await renewed(() => page.getByRole("button", { name: "As given", exact: true }).click());
    await page.getByRole("tab", { name: "Effects" }).click();
    const effect = live.locator(`[data-effect=${plan.effect}]`);
    await renewed(() => effect.getByRole("switch").click());
    for (const [i, v] of (plan.values ?? []).entries()) {
      const at = effect.locator(".field").nth(i);
      await renewed(async () => {
        await at.fill(String(v));
        await at.press("Enter");
      });
    }
    seen.withEffect = await errors();
    seen.fallOfEffect = await waterfall();
    await shoot("effect");
  }
  if (plan.model) {
    await renewed(() => page.getByRole("button", { name: plan.model, exact: true }).click());
    seen.ofModel = await errors();
    seen.fallOfModel = await waterfall();
    await download("Save model.osim", plan.files ?? 1);
    await shoot("model");
    if (plan.last) {
      await page.getByRole("tab", { name: "Effects" }).click();
      await renewed(() => live.locator(`[data-effect=${plan.last}]`).getByRole("switch").click());
      seen.withoutLast = await errors();
    }
  }
  if (plan.fit) {
    await page.getByRole("button", { name: "Fit muscles" }).click();
    await page.waitForFunction(() => document.getElementById("live").dataset.fitted, null, looks);
    seen.fittedSeconds = Number((await data()).fitted);
    await page.waitForTimeout(1000);
    seen.fitted = await errors();
    await download("Save parameters");
    await shoot("fitted");
  }
  if (plan.motion) await motion(page, seen, download, shoot);
  seen.text = await live.innerText();
});
writeFileSync(seenFile, JSON.stringify(seen));

/** The model in the chosen trial: it is drawn, plays, and a muscle that is pointed at stands out. */
async function motion(page, seen, download, shoot) {
  const panel = page.locator(".live-motion");
  await panel.scrollIntoViewIfNeeded();
  await page.waitForFunction(() => document.querySelector(".live-motion").dataset.sample, null, looks);
  await page.waitForFunction(() => document.querySelectorAll(".live-motion .curve.series").length > 0, null, looks);
  const sample = async () => Number(await panel.getAttribute("data-sample"));
  seen.motion = { trial: await page.locator(".live-focus h3 small").innerText(), before: await sample() };
  await panel.getByRole("button", { name: "Play", exact: true }).click();
  await page.waitForFunction(
    (before) => Number(document.querySelector(".live-motion").dataset.sample) > before + 10,
    seen.motion.before,
    looks,
  );
  await panel.getByRole("button", { name: "Pause", exact: true }).click();
  seen.motion.after = await sample();
  await shoot("motion");
  // The time of a curve that is pointed at is that of the model.
  const figure = page.locator(".live-focus .live-figure").first();
  await figure.scrollIntoViewIfNeeded();
  await figure.hover({ position: { x: 60, y: 60 } });
  await page.waitForFunction(
    (before) => Number(document.querySelector(".live-motion").dataset.sample) < before,
    seen.motion.before,
    looks,
  );
  seen.motion.pointed = await sample();
  await panel.locator(".live-name").first().focus();
  seen.motion.lit = await page.evaluate(() => [
    document.querySelectorAll(".live-motion .curve.lit").length,
    document.querySelectorAll("#live fieldset.lit").length,
  ]);
  await download("Save numbers of: Moment of every muscle in the chosen trial");
  await download("Save as SVG: Moment of every muscle in the chosen trial");
  await download("Save as PNG: Moment of every muscle in the chosen trial");
  await download("Save a picture of the model (PNG)");
}
