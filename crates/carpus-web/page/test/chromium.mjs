// Chromium as a person has it, without a graphics card, and what it noted of a page.
import { mkdtempSync, readFileSync, rmSync } from "node:fs";
import { tmpdir } from "node:os";
import path from "node:path";
import { pathToFileURL } from "node:url";
import { chromium } from "playwright-core";

const args = [
  "--no-sandbox",
  "--no-first-run",
  "--disable-background-networking",
  "--disable-component-update",
  "--disable-sync",
  // Three dimensions are drawn by the processor.
  "--use-gl=angle",
  "--use-angle=swiftshader",
  "--enable-unsafe-swiftshader",
];

/** Looked at now and then: a look at every frame would keep the browser drawing while the page computes. */
export const looks = { timeout: 300_000, polling: 50 };

/** Opens a page from disk; `act` does with it what is to be done. What was seen comes back. */
export const withPage = (file, options, act) => withAddress(pathToFileURL(path.resolve(file)).href, options, act);

/** Opens an address. */
export async function withAddress(own, options, act) {
  const profile = mkdtempSync(path.join(tmpdir(), "carpus-browser-"));
  const context = await chromium.launchPersistentContext(profile, {
    executablePath: process.env.CARPUS_CHROMIUM ?? "/usr/bin/chromium",
    args,
    headless: true,
    acceptDownloads: true,
    viewport: { width: 1366, height: 768 },
    ...options,
  });
  const seen = { requests: [], complaints: [], downloads: {} };
  try {
    const page = await context.newPage();
    page.setDefaultTimeout(120_000);
    context.on("request", (request) => {
      const is = request.url().split("#")[0];
      if (is !== own && !/^(blob:|data:)/.test(is)) seen.requests.push(request.url());
    });
    page.on("console", (message) => {
      if (message.type() === "error") seen.complaints.push(message.text());
    });
    page.on("pageerror", (error) => seen.complaints.push(String(error)));
    await page.goto(own);
    const downloads = async (click, count = 1) => {
      const files = [];
      const all = new Promise((resolve, reject) => {
        page.on("download", (d) => {
          files.push(d);
          if (files.length === count) resolve();
        });
        const late = () => reject(new Error(`${files.length} of ${count} files were saved`));
        setTimeout(late, 60_000).unref();
      });
      await click();
      await all;
      for (const f of files) seen.downloads[f.suggestedFilename()] = readFileSync(await f.path()).toString("base64");
    };
    await act(page, seen, downloads);
    seen.executed = await page.evaluate(() => Boolean(window.executed));
    seen.nameless = await page.evaluate(() =>
      [...document.querySelectorAll("#live :is(input, select, button, canvas)")]
        .filter((e) => !(e.getAttribute("aria-label") || e.labels?.length || e.textContent.trim() || e.title))
        .map((e) => e.outerHTML.slice(0, 120)),
    );
  } finally {
    await context.close();
    rmSync(profile, { recursive: true, force: true });
  }
  return seen;
}
