// Opens a page in headless Chromium, clicks through it and prints what it found as JSON.
//
// Usage: NODE_PATH=node_modules node browser.cjs PAGE CHROMIUM MOTION TIMES
// MOTION names a motion of the page, TIMES are seconds, parted by commas, at which to say where its nodes are.
const fs = require("fs");
const axe = require.resolve("axe-core/axe.min.js");
const { HtmlValidate } = require("html-validate");
const puppeteer = require("puppeteer-core");

const wait = (ms) => new Promise((done) => setTimeout(done, ms));

async function main() {
  const [, , path, chromium, motion, times] = process.argv;
  const found = { faults: [], requests: [], violations: [], invalid: [] };
  const browser = await puppeteer.launch({
    executablePath: chromium,
    headless: "new",
    args: ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist"],
  });
  const page = await browser.newPage();
  page.on("console", (message) => {
    if (["error", "warning", "warn"].includes(message.type())) {
      // What a software renderer says of reading pixels back is no fault of the page.
      if (!message.text().includes("GPU stall due to ReadPixels")) found.faults.push(message.text());
    }
  });
  page.on("pageerror", (error) => found.faults.push(error.message));
  page.on("request", (request) => found.requests.push(request.url().slice(0, 80)));
  await page.setViewport({ width: 1280, height: 900 });
  await page.goto(`file://${path}`);
  await page.waitForFunction(() => document.querySelector('[aria-current="true"]') && window.report.player.glb);
  found.first_paint_ms = await page.evaluate(() => {
    const paint = performance.getEntriesByName("first-contentful-paint")[0];
    return paint ? paint.startTime : performance.getEntriesByType("navigation")[0].domContentLoadedEventEnd;
  });

  const text = (selector) => page.$eval(selector, (one) => one.textContent.trim());
  found.headline = await text("#headline");
  found.sections = await page.$$eval("main h2", (all) => all.map((one) => one.textContent));
  const rows = (id) => page.$$eval(`#table-${id} tbody tr`, (all) =>
    all.map((row) => Array.from(row.children, (cell) => cell.textContent.trim())));
  found.objects = await rows("by_object");
  found.reasons = await rows("by_reason");
  found.figures = await rows("figures");
  found.funnel = await rows("funnel");
  found.motions_n = (await page.$$(".motion")).length;

  // A filter leaves the motions of one object, and a click on an object does the same.
  const visible = () => page.$$eval(".motion", (all) =>
    all.filter((one) => !one.parentElement.hidden).map((one) => one.dataset.object));
  const object = await page.$eval(`[data-id="${motion}"]`, (one) => one.dataset.object);
  await page.select("#filter-object", object);
  found.filtered = await visible();
  found.count = await text("#shown-count");
  await page.select("#filter-object", "");
  found.unfiltered_n = (await visible()).length;
  await page.click(`[data-filter="object"][data-value="${object}"]`);
  await wait(200);
  found.clicked = await visible();
  await page.select("#filter-object", "");

  // A click on a motion plays it; the button pauses it.
  await page.click(`[data-id="${motion}"]`);
  await wait(700);
  found.played_s = await page.evaluate(() => window.report.player.time);
  found.says_pause = await text("#play");
  await page.click("#play");
  const paused = await page.evaluate(() => window.report.player.time);
  await wait(200);
  found.is_paused = paused === (await page.evaluate(() => window.report.player.time));
  found.name = await text("#motion-name");

  // The slider scrubs, and another picture is drawn.
  const picture = () => page.evaluate(() => { window.report.draw(); return window.report.player.canvas.toDataURL(); });
  const scrub = (share) => page.$eval("#scrub", (slider, share) => {
    slider.value = String(share * Number(slider.max));
    slider.dispatchEvent(new Event("input", { bubbles: true }));
  }, share);
  await scrub(0);
  const first = await picture();
  found.blank = await page.evaluate(() => {
    const { gl, canvas } = window.report.player;
    const pixels = new Uint8Array(4 * canvas.width * canvas.height);
    gl.readPixels(0, 0, canvas.width, canvas.height, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
    return pixels.every((one) => one === 0);
  });
  await scrub(0.9);
  found.scrub_changes = first !== (await picture());
  found.scrubbed = await text("#time");

  // Dragging turns the view; keys change the motion.
  const before = await picture();
  const box = await (await page.$("#view")).boundingBox();
  await page.evaluate(() => document.getElementById("view").scrollIntoView({ block: "center" }));
  const at = await (await page.$("#view")).boundingBox();
  await page.mouse.move(at.x + at.width / 2, at.y + at.height / 2);
  await page.mouse.down();
  await page.mouse.move(at.x + at.width / 2 + 90, at.y + at.height / 2 + 20, { steps: 4 });
  await page.mouse.up();
  found.drag_turns = before !== (await picture()) && box.width > 100;
  const current = () => page.$eval('[aria-current="true"]', (one) => one.dataset.id);
  await page.focus("#view");
  await page.keyboard.press("n");
  await wait(300);
  found.next = await current();
  await page.keyboard.press("p");
  await wait(300);
  found.previous = await current();
  await page.select("#speed", "0.25");
  await page.keyboard.press(" ");
  await wait(300);
  found.key_plays = await page.evaluate(() => window.report.state.plays);
  await page.keyboard.press(" ");

  // Where the player shows the nodes.
  found.poses = await page.evaluate(async (motion, times) => {
    const button = document.querySelector(`[data-id="${motion}"]`);
    const glb = await window.report.load(Number(button.dataset.idx));
    const names = glb.json.nodes.map((node) => node.name).filter((name) => !/^(world|table|ghost_|contact_)/.test(name));
    return times.map((time) => Object.fromEntries(names.map((name) => [name, glb.tableFrom(name, time)])));
  }, motion, times.split(",").map(Number));

  await page.addScriptTag({ path: axe });
  for (const scheme of ["light", "dark"]) {
    await page.emulateMediaFeatures([{ name: "prefers-color-scheme", value: scheme }]);
    const { violations } = await page.evaluate(() => window.axe.run(document));
    found.violations.push(...violations.map((one) => `${scheme}: ${one.id}: ${one.help}: ${one.nodes[0].html.slice(0, 200)}`));
  }
  await browser.close();

  const validator = new HtmlValidate({ extends: ["html-validate:standard"] });
  const html = fs.readFileSync(path, "utf8");
  const report = await validator.validateString(html);
  for (const { messages } of report.results)
    found.invalid.push(...messages.map((one) => `${one.line}:${one.column} ${one.ruleId}: ${one.message}`));
  console.log(JSON.stringify(found));
}

main().catch((error) => { console.error(error); process.exit(1); });
