// SPDX-License-Identifier: Apache-2.0
// A small HTTP server of one file, with the faults that tests want.
import {createServer} from 'node:http';

/**
 * @param {Uint8Array} bytes
 * @param {{ranges?: boolean, etag?: () => string, fail?: (count: number) => number | 'cut' | undefined, rate?: number}} [options]
 * fail: a status to answer instead, or 'cut': half of the answer; rate: bytes a second of all answers together
 */
export const serve = async (bytes, {ranges = true, etag = () => '"1"', fail, rate = Infinity} = {}) => {
  let free = 0;
  /** @type {[number, number][]} */
  const requests = [];
  const server = createServer(async (request, response) => {
    const match = /^bytes=(\d+)-(\d+)$/.exec(request.headers.range ?? '');
    const begin = match ? Number(match[1]) : 0;
    const end = Math.min(match ? Number(match[2]) + 1 : bytes.length, bytes.length);
    requests.push([begin, end - begin]);
    const fault = fail?.(requests.length);
    if (typeof fault === 'number') return response.writeHead(fault).end();
    const changed = request.headers['if-range'] && request.headers['if-range'] !== etag();
    const part = ranges && match && !changed;
    const body = part ? bytes.subarray(begin, end) : bytes;
    if (part && begin >= bytes.length) return response.writeHead(416).end();
    response.writeHead(part ? 206 : 200, {
      'Content-Length': body.length, ETag: etag(),
      ...part && {'Content-Range': `bytes ${begin}-${end - 1}/${bytes.length}`}
    });
    if (fault === 'cut') {
      response.write(body.subarray(0, body.length / 2), () => response.destroy());
    } else {
      for (let at = 0; at < body.length && rate < Infinity; at += 4096) {
        free = Math.max(free, performance.now()) + 1000 * 4096 / rate;
        await new Promise(resolve => setTimeout(resolve, free - performance.now()));
        if (response.destroyed) return;
        response.write(body.subarray(at, at + 4096));
      }
      response.end(rate < Infinity ? undefined : body);
    }
  });
  await new Promise(resolve => server.listen(0, '127.0.0.1', () => resolve(undefined)));
  const address = /** @type {import('node:net').AddressInfo} */ (server.address());
  return {
    url: `http://127.0.0.1:${address.port}/scene.l4d`, requests,
    /** @returns {Promise<number>} */
    connections: () => new Promise((resolve, reject) => server.getConnections((error, n) => error ? reject(error) : resolve(n))),
    close: () => { server.closeAllConnections(); server.close(); }
  };
};

/**
 * A server of files by name, which tests change. Knows ranges, and no conditions, as its files grow.
 * @param {Map<string, Uint8Array>} files
 */
export const serveFiles = async files => {
  const faults = {status: 0, ranges: true};
  /** @type {{name: string, begin: number, bytes: number, headers: import('node:http').IncomingHttpHeaders}[]} */
  const requests = [];
  const server = createServer((request, response) => {
    const name = decodeURIComponent((request.url ?? '/').slice(1));
    const bytes = files.get(name);
    if (faults.status || !bytes) return response.writeHead(faults.status || 404).end();
    const match = faults.ranges ? /^bytes=(\d+)-(\d+)$/.exec(request.headers.range ?? '') : null;
    const begin = match ? Number(match[1]) : 0;
    const end = Math.min(match ? Number(match[2]) + 1 : bytes.length, bytes.length);
    requests.push({name, begin, bytes: end - begin, headers: request.headers});
    if (begin >= bytes.length) return response.writeHead(416).end();
    response.writeHead(match ? 206 : 200, {
      'Content-Length': end - begin, ETag: `"${bytes.length}"`,
      ...match && {'Content-Range': `bytes ${begin}-${end - 1}/${bytes.length}`}
    }).end(bytes.subarray(begin, end));
  });
  const listen = (/** @type {number} */ port) => new Promise(resolve => server.listen(port, '127.0.0.1', () => resolve(undefined)));
  await listen(0);
  const {port} = /** @type {import('node:net').AddressInfo} */ (server.address());
  const close = () => { server.closeAllConnections(); server.close(); };
  return {url: `http://127.0.0.1:${port}/`, requests, faults, close, again: () => listen(port)};
};
