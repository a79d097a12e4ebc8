// SPDX-License-Identifier: Apache-2.0
// One browser and one server of streams for all tests of a file.
import {join} from 'node:path';
import {after, before} from 'node:test';
import {launch, pageWith, serve, work} from './browser.js';

/**
 * To be called before the tests. Returns what is as pageWith() of browser.js. @param {...string} names of streams
 * @returns {(body: string, fn: (page: any) => Promise<void>, how?: any) => Promise<void>}
 */
export const pagesWith = (...names) => {
  let browser, server;
  before(async () => {
    browser = await launch();
    server = await serve(Object.fromEntries(names.map(name => [`${name}.l4d`, join(work, `${name}.l4d`)])));
  });
  after(async () => {
    await browser?.close();
    server?.close();
  });
  return (body, fn, how) => pageWith(browser, server, body, fn, how);
};
