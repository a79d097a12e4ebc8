// SPDX-License-Identifier: Apache-2.0
// A small HTTP server of one file, with the faults that tests want.
import {createServer} from 'node:http';

/**
 * @typedef {{begin: number, end: number, status: number, headers: Record<string, any>, body: Uint8Array}} Answer
 * @param {Uint8Array} bytes
 * @param {{ranges?: boolean, etag?: () => string, fail?: (count: number) => number | 'cut' | 'silent' | 'stuck' | undefined, rate?: number,
 *   headers?: (count: number) => Record<string, string>, lie?: (answer: Answer) => void}} [options] fail: a status to answer instead; 'cut': half of the answer,
 *   'stuck': that, and no end; 'silent': no answer; rate: bytes a second of all answers together; headers: also of answers; lie: changes an answer
 */
export const serve = async (bytes, {ranges = true, etag = () => '"1"', fail, rate = Infinity, headers = () => ({}), lie} = {}) => {
  let free = 0;
  /** @type {[number, number][]} */
  const requests = [];
  /** @type {import('node:http').IncomingMessage[]} */
  const seen = [];
  /** What tests set later: as `fail`. @type {{fault?: any, answer?: (request: import('node:http').IncomingMessage) => any}} */
  const shared = {};
  const server = createServer(async (request, response) => {
    seen.push(request);
    const match = /^bytes=(\d+)-(\d*)$/.exec(request.headers.range ?? '');
    const begin = match ? Number(match[1]) : 0;
    const end = Math.min(match?.[2] ? Number(match[2]) + 1 : bytes.length, bytes.length);
    requests.push([begin, end - begin]);
    const fault = shared.fault ?? shared.answer?.(request) ?? fail?.(requests.length);
    if (typeof fault === 'number') return response.writeHead(fault).end();
    if (fault === 'silent') return;
    const part = ranges && match;
    if (part && begin >= bytes.length) return response.writeHead(416).end();
    /** @type {Answer} */
    const answer = {
      begin, end, status: part ? 206 : 200, body: part ? bytes.subarray(begin, end) : bytes,
      headers: {...etag() && {ETag: etag()}, ...part && {'Content-Range': `bytes ${begin}-${end - 1}/${bytes.length}`}, ...headers(requests.length)}
    };
    lie?.(answer);
    const {body} = answer;
    response.writeHead(answer.status, {'Content-Length': body.length, ...answer.headers});
    if (fault === 'cut' || fault === 'stuck') {
      response.write(body.subarray(0, body.length / 2), () => { if (fault === 'cut') response.destroy(); });
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
  return Object.assign(shared, {
    url: `http://127.0.0.1:${address.port}/scene.l4d`, requests, seen,
    /** @returns {Promise<number>} */
    connections: () => new Promise((resolve, reject) => server.getConnections((error, n) => error ? reject(error) : resolve(n))),
    close: () => { server.closeAllConnections(); server.close(); }
  });
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
