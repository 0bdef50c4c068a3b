// Opens a report in Chromium as a person would, does what a plan says, and tells what was seen.
//
//   node browser.mjs REPORT.html PLAN.json SEEN.json
//
// A plan: { "fields": [[muscle, property, value]], "effect": id or null, "values": [..],
// "model": label or null, "last": the last of its effects or null, "fit": true or false,
// "screenshots": folder or null }.
import { mkdtempSync, readFileSync, rmSync, writeFileSync } from "node:fs";
import { tmpdir } from "node:os";
import path from "node:path";
import { pathToFileURL } from "node:url";
import { chromium } from "playwright-core";

const [report, planFile, seenFile] = process.argv.slice(2);
const plan = JSON.parse(readFileSync(planFile, "utf8"));
const executablePath = process.env.CARPUS_CHROMIUM ?? "/usr/bin/chromium";
const profile = mkdtempSync(path.join(tmpdir(), "carpus-browser-"));
const args = [
  "--no-sandbox",
  "--disable-gpu",
  "--no-first-run",
  "--disable-background-networking",
  "--disable-component-update",
  "--disable-sync",
];
// Looked at now and then: a look at every frame would keep the browser drawing while the page computes.
const looks = { timeout: 300_000, polling: 50 };
const context = await chromium.launchPersistentContext(profile, {
  executablePath,
  args,
  headless: true,
  acceptDownloads: true,
  viewport: { width: 1366, height: 768 },
  colorScheme: plan.theme ?? "light",
});
const seen = { requests: [], complaints: [], downloads: {} };
try {
  const page = await context.newPage();
  const own = pathToFileURL(path.resolve(report)).href;
  const note = (request) => {
    if (request.url().split("#")[0] !== own && !/^(blob:|data:)/.test(request.url())) seen.requests.push(request.url());
  };
  context.on("request", note);
  page.on("console", (message) => {
    if (message.type() === "error") seen.complaints.push(message.text());
  });
  page.on("pageerror", (error) => seen.complaints.push(String(error)));
  await page.goto(own);
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
    const files = [];
    const all = new Promise((resolve) =>
      page.on("download", (d) => {
        files.push(d);
        if (files.length === count) resolve();
      }),
    );
    await page.getByRole("button", { name, exact: true }).click();
    await all;
    for (const file of files)
      seen.downloads[file.suggestedFilename()] = readFileSync(await file.path()).toString("base64");
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
  seen.executed = await page.evaluate(() => Boolean(window.executed));
  seen.text = await live.innerText();
} finally {
  await context.close();
  rmSync(profile, { recursive: true, force: true });
}
writeFileSync(seenFile, JSON.stringify(seen));
