// Opens the page of a model in Chromium as a person would, does what a plan says, and tells what was seen.
//
//   node view.mjs PAGE.html PLAN.json SEEN.json
//
// A plan: { "set": [[coordinate, value]], "over": coordinate of the curves or null, "save": true or false, "theme":
// "light" or "dark", "size": [width, height] or null, "screenshots": folder or null, "tables": [[files]] that are chosen one
// after another, or null }.
import { readFileSync, writeFileSync } from "node:fs";
import path from "node:path";
import { looks, withPage } from "./chromium.mjs";

const [file, planFile, seenFile] = process.argv.slice(2);
const plan = JSON.parse(readFileSync(planFile, "utf8"));
const [width, height] = plan.size ?? [1366, 768];
const options = { colorScheme: plan.theme ?? "light", reducedMotion: "reduce", viewport: { width, height } };
const seen = await withPage(file, options, async (page, seen, downloads) => {
  const data = () => page.evaluate(() => ({ ...document.getElementById("live").dataset }));
  await page.waitForFunction(() => document.getElementById("live").dataset.started, null, looks);
  seen.startedMs = Number((await data()).started);
  const shoot = async (name) => {
    if (plan.screenshots) await page.screenshot({ path: path.join(plan.screenshots, `${name}.png`) });
  };
  const renewed = async (act) => {
    const before = (await data()).renewed;
    await act();
    await page.waitForFunction(
      (b) => {
        const { renewed: now, settled } = document.getElementById("live").dataset;
        return now !== b && settled === "true";
      },
      before,
      looks,
    );
    const { changed, renewed: now } = await data();
    return Number(now) - Number(changed);
  };
  await shoot("start");
  if (plan.over) {
    const choice = page.getByLabel("Coordinate of the curves and moment arms");
    const now = await choice.evaluate((e) => e.selectedOptions[0].textContent);
    if (now !== plan.over) await renewed(() => choice.selectOption({ label: plan.over }));
  }
  const field = (name) => page.locator(`[data-coordinate="${name}"] .field`);
  for (const [name, value] of plan.set) {
    await renewed(async () => {
      await field(name).fill(String(value));
      await field(name).press("Enter");
    });
  }
  seen.muscles = await page.evaluate(() =>
    Object.fromEntries(
      [...document.querySelectorAll("tr[data-muscle]")].map((row) => [
        row.dataset.muscle,
        [Number(row.dataset.length), Number(row.dataset.arm)],
      ]),
    ),
  );
  await shoot("posture");
  if (plan.save) {
    await renewed(() => page.getByRole("button", { name: "All that turn it", exact: true }).click());
    for (const [what, figure] of [
      ["Lengths of the chosen muscles", "length"],
      ["Moment arms of the chosen muscles", "moment_arm"],
    ]) {
      for (const kind of ["Save as SVG", "Save as PNG", "Save numbers of"]) {
        await downloads(() => page.getByRole("button", { name: `${kind}: ${what}`, exact: true }).click());
      }
      seen[figure] = await page.locator(`svg[aria-label="${what}"] .curve`).count();
    }
    for (const name of ["Save posture", "Save path points", "Save a picture of the model (PNG)"]) {
      await downloads(() => page.getByRole("button", { name, exact: true }).click());
    }
    await page.getByLabel("Moment arms", { exact: true }).check();
    await page.waitForFunction(() => document.querySelector(".live-label"), null, looks);
    seen.labels = await page.locator(".live-label").allInnerTexts();
    await shoot("moment_arms");
    await keyboard(page, seen, renewed);
    await pointed(page, seen);
    await shoot("pointed");
  }
  seen.tables = [];
  for (const files of plan.tables ?? []) {
    const picker = page.getByLabel("Tables of OpenSim to compare with");
    await picker.setInputFiles([]);
    await renewed(() => picker.setInputFiles(files));
    const rows = await page.evaluate(() => [...document.querySelectorAll(".live-table li")].map((li) => ({ ...li.dataset })));
    seen.tables.push({
      said: await page.locator(".live-table").innerText(),
      rows,
      lengths: await page.locator('svg[aria-label="Lengths of the chosen muscles"] .curve.theirs').count(),
      arms: await page.locator('svg[aria-label="Moment arms of the chosen muscles"] .curve.theirs').count(),
      error: await page.locator(".live-table-error").count(),
    });
    await shoot(`table_${seen.tables.length}`);
  }
  seen.text = await page.locator("main").innerText();
});
writeFileSync(seenFile, JSON.stringify(seen));

/** Steps of a slider and turns of the model by keys alone. */
async function keyboard(page, seen, renewed) {
  const slider = page.locator(".live-side input[type=range]:not(:disabled)").first();
  seen.renewedMs = [];
  for (let i = 0; i < 20; i += 1) seen.renewedMs.push(await renewed(() => slider.press("ArrowRight")));
  const picture = () => page.evaluate(() => document.querySelector(".live-stage canvas").toDataURL());
  await page.locator(".live-stage canvas").focus();
  seen.turned = [];
  for (const key of ["ArrowLeft", "+", "Home"]) {
    const before = await picture();
    await page.keyboard.press(key);
    let turned = false;
    for (let i = 0; i < 80 && !turned; i += 1) {
      await page.waitForTimeout(250);
      turned = (await picture()) !== before;
    }
    seen.turned.push(turned);
  }
}

/** A muscle that is pointed at in three dimensions stands out in the list and as a curve. */
async function pointed(page, seen) {
  const box = await page.locator(".live-stage canvas").boundingBox();
  for (let row = 1; row < 24 && !seen.pointed; row += 1)
    for (let column = 1; column < 24 && !seen.pointed; column += 1) {
      await page.mouse.move(box.x + (box.width * column) / 24, box.y + (box.height * row) / 24);
      seen.pointed = await page.evaluate(() => {
        const lit = document.querySelector("tr.lit.picked");
        return lit ? [lit.dataset.muscle, document.querySelectorAll(".curve.lit").length] : null;
      });
    }
}
