// Drives Debian's Chromium for tests (browser.py), pictures and the bench of pages: one command as JSON a line on standard input, one answer a line.
//   {"open": URL, "width": 1280, "height": 800, "scheme": "light"}   a new page
//   {"until": EXPRESSION}    waits until the expression is true in the page, and answers its value
//   {"fill": SELECTOR, "text": "…"}  {"click": SELECTOR}  {"press": KEY}
//   {"axe": true}            the violations of axe-core
//   {"shot": FILE}           a picture
// Each answer has `value`, or `error`, and `console`: what the page has reported since the last answer.
const readline = require('node:readline');
const path = require('node:path');
const modules = path.join(process.argv[2], 'node_modules');
const {chromium} = require(path.join(modules, 'playwright-core'));
const {AxeBuilder} = require(path.join(modules, '@axe-core', 'playwright'));

const QUIET = ['--no-sandbox', '--disable-gpu', '--disable-quic', '--no-first-run', '--disable-background-networking',
  '--disable-component-update', '--disable-sync', '--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1'];
const PATIENCE = 30000;
let page = null;
let reports = [];

async function until(expression) {
  const end = Date.now() + PATIENCE;
  let last;
  while (Date.now() < end) {
    last = await page.evaluate(expression).catch((fault) => { last = fault.message; return false; });
    if (last) return last;
    await new Promise((done) => setTimeout(done, 50));
  }
  throw new Error(`not true in time: ${expression}; the page says: ${(await page.innerText('body')).slice(0, 1500)}`);
}

async function obey(browser, command) {
  if (command.open) {
    if (page) await page.context().close();
    const context = await browser.newContext({viewport: {width: command.width ?? 1280, height: command.height ?? 800},
      colorScheme: command.scheme ?? 'light'});
    page = await context.newPage();
    page.on('console', (message) => { if (message.type() === 'error' || message.type() === 'warning') reports.push(message.text()); });
    page.on('pageerror', (fault) => reports.push(fault.message));
    page.on('dialog', (dialog) => { reports.push(`dialog: ${dialog.message()}`); dialog.dismiss(); });
    await page.goto(command.open);
  } else if (command.until) {
    return await until(command.until);
  } else if (command.fill) {
    await page.fill(command.fill, command.text);
  } else if (command.click) {
    await page.click(command.click);
  } else if (command.press) {
    await page.keyboard.press(command.press);
  } else if (command.axe) {
    const {violations} = await new AxeBuilder({page}).analyze();
    return violations.map((one) => `${one.id}: ${one.nodes.map((node) => node.html.slice(0, 200)).join(' | ')}`);
  } else if (command.shot) {
    await page.screenshot({path: command.shot});
  }
  return null;
}

(async () => {
  const browser = await chromium.launch({executablePath: '/usr/bin/chromium', args: QUIET});
  for await (const line of readline.createInterface({input: process.stdin})) {
    let answer;
    try {
      answer = {value: await obey(browser, JSON.parse(line))};
    } catch (fault) {
      answer = {error: fault.message};
    }
    answer.console = reports;
    reports = [];
    process.stdout.write(JSON.stringify(answer) + '\n');
  }
  await browser.close();
})();
