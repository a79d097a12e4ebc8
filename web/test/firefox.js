// SPDX-License-Identifier: Apache-2.0
// How the tests drive Firefox as it is released: by WebDriver BiDi, with what playwright-core lacks of it. chromium.js offers
// the same. WebGL needs a display, also that of Xvfb, where Mesa draws on the processor (web/test/run.sh firefox).
import {firefox} from 'playwright-core';

export const name = 'Firefox';

const prefs = {
  'app.update.enabled': false,
  // What it fetches by itself, and then complains of.
  'browser.chrome.site_icons': false,
  // As it is released: playwright-core lets files read each other.
  'security.fileuri.strict_origin_policy': true,
  // Fingers of tests are those of a screen that can be touched.
  'dom.w3c_touch_events.enabled': 1
};

/** The server's side of an object of playwright-core, which runs in this process. @param {any} object */
const inside = object => object._connection.toImpl(object);

/**
 * @param {{webgpu?: boolean, gpu?: boolean, webgl?: boolean}} [options] as launch() of browser.js takes them; there is WebGPU
 * for no page of Firefox without a GPU
 */
export const launch = async ({webgl = true} = {}) => {
  const browser = /** @type {any} */ (await firefox.launch({
    channel: 'moz-firefox', executablePath: process.env.L4D_FIREFOX ?? '/usr/bin/firefox-esr', headless: !process.env.DISPLAY,
    firefoxUserPrefs: {...prefs, 'webgl.disabled': !webgl}, args: ['-remote-allow-system-access']
  }));
  const session = inside(browser)._browserSession;
  // Releases do not know this command yet, and playwright-core starts each page with it.
  const send = session.send.bind(session);
  session.send = (/** @type {string} */ method, /** @type {any} */ given) =>
    method === 'emulation.setMediaFeaturesOverride' ? Promise.resolve({}) : send(method, given);
  const newPage = browser.newPage.bind(browser);
  browser.newPage = async (/** @type {any} */ options = {}) => {
    const page = await newPage(options);
    page.emulateMedia = (/** @type {any} */ media) => emulateMedia(page, media);
    await page.emulateMedia({reducedMotion: options.reducedMotion ?? null});
    return page;
  };
  return browser;
};

/** The identifier of a page in WebDriver BiDi. @param {any} page */
const idOf = page => inside(page).delegate._session.sessionId;

/**
 * Calls fn in the browser itself with `context`, the BrowsingContext of the page, and what is given.
 * @param {any} page @param {(context: any, ...given: any[]) => any} fn @param {...any} given
 */
const inBrowser = async (page, fn, ...given) => {
  const {send} = inside(page.context().browser())._browserSession;
  const {contexts} = await send('browsingContext.getTree', {'moz:scope': 'chrome'});
  const {context} = contexts.find((/** @type {any} */ {url}) => url === 'chrome://browser/content/browser.xhtml');
  const {result, exceptionDetails} = await send('script.evaluate', {
    expression: `(async () => {
      const {NavigableManager} = ChromeUtils.importESModule('chrome://remote/content/shared/NavigableManager.sys.mjs');
      return JSON.stringify(await (${fn})(NavigableManager.getBrowsingContextById('${idOf(page)}'), ...${JSON.stringify(given)}) ?? null);
    })()`,
    target: {context}, awaitPromise: true
  });
  if (exceptionDetails) throw new Error(exceptionDetails.text);
  return JSON.parse(result.value);
};

/** @param {any} page @param {{reducedMotion?: 'reduce' | null}} media */
const emulateMedia = (page, {reducedMotion = null}) => inBrowser(page, (context, value) => {
  context.prefersReducedMotionOverride = value;
}, reducedMotion ?? 'none');

/** Resolves once all that the page complained of until now has come, which is later than answers do. @param {any} page */
export const allSaid = async page => {
  const mark = `all is said ${Math.random()}`;
  const said = page.waitForEvent('pageerror', (/** @type {Error} */ error) => String(error).includes(mark));
  await page.evaluate((/** @type {string} */ mark) => reportError(new Error(mark)), mark);
  await said;
  page.errors = page.errors.filter((/** @type {string} */ error) => !error.includes(mark));
  // What WebGL complains of is said to the browser alone. That textures are cleared before a part of them is filled is no fault.
  page.errors.push(...await inBrowser(page, () => {
    const messages = Services.console.getMessageArray().map((/** @type {any} */ {message}) => message);
    Services.console.reset();
    return messages.filter((/** @type {string} */ text) => /WebGL warning/.test(text) && !/initializ/.test(text));
  }));
};

/**
 * Fingers on a page: as touch() of browser.js. Those of WebDriver reach the page alone; these reach the window, which scrolls.
 * @param {any} page
 */
export const touch = async page => {
  /** @type {number[][]} */
  let last = [];
  const send = async (/** @type {number[][]} */ points, isOn = true) => {
    last = points;
    await inBrowser(page, (context, points, isOn) => {
      const {screenX, screenY, ownerDocument: {defaultView: {windowUtils, devicePixelRatio}}} = context.embedderElement;
      const {TOUCH_CONTACT, TOUCH_REMOVE} = Ci.nsIDOMWindowUtils;
      for (const [id, [x, y]] of points.entries()) {
        windowUtils.sendNativeTouchPoint(id, isOn ? TOUCH_CONTACT : TOUCH_REMOVE, Math.round((screenX + x) * devicePixelRatio),
                                         Math.round((screenY + y) * devicePixelRatio), 1, 90, null);
      }
    }, points, isOn);
    // It goes to the page by way of what scrolls, and tells nobody when it is there.
    await page.evaluate(() => new Promise(resolve => requestAnimationFrame(() => requestAnimationFrame(resolve))));
  };
  return {start: send, move: send, end: () => send(last, false)};
};

/**
 * What is there behind a collection: as heap() of browser.js, by what about:memory counts for the window of the page. It has
 * the bytes of nodes: 120 for each.
 * @param {any} page
 */
export const heap = page => inBrowser(page, async context => {
  const {messageManager} = context.embedderElement;
  await new Promise(resolve => {
    const done = () => {
      messageManager.removeMessageListener('l4d:collected', done);
      resolve(undefined);
    };
    messageManager.addMessageListener('l4d:collected', done);
    messageManager.loadFrameScript(`data:,${encodeURIComponent(
      'for (let k = 0; k < 3; ++k) { Cu.forceGC(); Cu.forceCC(); } sendAsyncMessage("l4d:collected");')}`, false);
  });
  const found = {bytes: 0, nodes: 0, listeners: 0};
  const window = `/window-objects/top(${context.currentURI.spec.replaceAll('/', '\\')}`;
  const add = (/** @type {string} */ _process, /** @type {string} */ path, /** @type {number} */ _kind, /** @type {number} */ _units,
               /** @type {number} */ amount) => {
    if (!path.includes(window)) return;
    if (path.endsWith('/dom/event-listeners')) found.listeners += amount;
    else if (/\/dom\/(element|text|orphan)-nodes$/.test(path)) found.nodes += amount / 120;
    if (/^explicit.*\/js-(zone|realm)/.test(path) && !path.endsWith('/unused-gc-things')) found.bytes += amount;
  };
  const manager = Cc['@mozilla.org/memory-reporter-manager;1'].getService(Ci.nsIMemoryReporterManager);
  await new Promise(resolve => manager.getReports(add, null, resolve, null, false));
  if (found.bytes === 0 || found.nodes === 0 || found.listeners === 0) throw new Error(`nothing is counted of ${window}`);
  return found;
});
