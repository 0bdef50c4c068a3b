// Opens the page of carpus live in Chromium as a person would, takes steps, and tells what was seen.
//
//   node server.mjs ADDRESS SEEN.json [FOLDER FOR SCREENSHOTS]
import { writeFileSync } from "node:fs";
import path from "node:path";
import { looks, withAddress } from "./chromium.mjs";

const [address, seenFile, screenshots] = process.argv.slice(2);
const origin = new URL(address).origin;

const seen = await withAddress(address, {}, async (page, seen) => {
  const shoot = async (name) => {
    if (screenshots) await page.screenshot({ path: path.join(screenshots, `${name}.png`) });
  };
  const current = async (text) => {
    const is = (t) => document.querySelector("#ledger li[aria-current] .what")?.textContent.startsWith(t);
    await page.waitForFunction(is, text, looks);
    return page.locator("#ledger li[aria-current] .what").textContent();
  };
  await page.waitForFunction(() => document.body.dataset.checks, null, looks);
  seen.address = page.url();
  seen.light = await page.locator("#light").textContent();
  await shoot("checked");

  // A step by the keyboard, its progress, its report.
  await page.evaluate(() => {
    window.progress = [];
    const what = document.getElementById("job-what");
    new MutationObserver(() => window.progress.push(what.textContent)).observe(what, { childList: true });
  });
  await page.locator("#command").selectOption("personalize");
  await page.getByRole("button", { name: "Run", exact: true }).press("Enter");
  await page.locator("#job").waitFor({ state: "visible" });
  await shoot("running");
  seen.current = [await current("1 personalize")];
  seen.progress = await page.evaluate(() => [...new Set(window.progress)]);
  const element = await page.locator("#report").elementHandle();
  const report = await element.contentFrame();
  await report.waitForFunction(() => document.getElementById("live")?.dataset.renewed, null, looks);
  seen.report = {
    computes: await report.evaluate(() => Boolean(document.getElementById("live").dataset.renewed)),
  };
  await shoot("report");
  await page.setViewportSize({ width: 1920, height: 1080 });
  await page.emulateMedia({ colorScheme: "dark", reducedMotion: "reduce" });
  await shoot("dark");
  await page.emulateMedia({ colorScheme: "light" });
  await page.setViewportSize({ width: 820, height: 1180 });
  await shoot("tablet");
  await page.setViewportSize({ width: 1366, height: 768 });

  // Back to the study as it is, and to the step again.
  await page.getByRole("button", { name: "make the study as it is the current one" }).click();
  seen.current.push(await current("The study as it is"));
  await page.getByRole("button", { name: "make step 1 the current one" }).click();
  seen.current.push(await current("1 personalize"));

  // A step that is stopped.
  await page.locator("#command").selectOption("diagnose");
  await page.getByRole("button", { name: "Run", exact: true }).click();
  await page.getByRole("button", { name: "Stop", exact: true }).click();
  await page.locator("#ledger li[data-step='2'][data-outcome=cancelled]").waitFor();
  seen.stopped = await page.locator("#ledger li[data-step='2']").textContent();

  // Effects are chosen one after the other.
  await page.locator("#command").selectOption("effect_add");
  await page.locator("#effect").selectOption("gravity");
  await page.locator("#effect").selectOption("joint_stiffness");
  await shoot("effects");
  seen.chosen = await page.locator("#chosen li").count();
  seen.nameless = await page.evaluate(() =>
    [...document.querySelectorAll("input, select, button, iframe, progress, pre")]
      .filter((e) => !(e.getAttribute("aria-label") || e.getAttribute("aria-labelledby") || e.labels?.length || e.textContent.trim() || e.title))
      .map((e) => e.outerHTML.slice(0, 120)),
  );
  seen.foreign = seen.requests.filter((url) => !url.startsWith(`${origin}/`));

  // What a script of a report would get: last, because the refusal is noted as a complaint.
  const noted = seen.complaints.length;
  seen.report.reaches = await report.evaluate(async (to) => {
    try {
      await fetch(to);
      return true;
    } catch {
      return false;
    }
  }, `${origin}/state`);
  seen.complaints.length = noted;
});
writeFileSync(seenFile, JSON.stringify(seen));
