// SPDX-License-Identifier: Apache-2.0
// Servers that people put streams on, as they are installed or as their makers document them, with the settings of docs/web.md.
import {execFileSync, spawn} from 'node:child_process';
import {createServer as createHttp} from 'node:http';
import {createSecureServer} from 'node:http2';
import {readFileSync, statSync, writeFileSync} from 'node:fs';
import {createServer as createTcp} from 'node:net';
import {join} from 'node:path';
import {createGzip} from 'node:zlib';

const root = process.env.L4D_ROOT ?? new URL('../..', import.meta.url).pathname;

/** The first block of code of a language below a heading of docs/web.md. @param {string} heading @param {string} language */
export const setting = (heading, language) => {
  const text = readFileSync(join(root, 'docs/web.md'), 'utf8');
  const found = text.slice(text.indexOf(`\n${heading}\n`)).match(new RegExp(`\`\`\`${language}\n([^]*?)\`\`\``));
  if (!text.includes(`\n${heading}\n`) || !found) throw new Error(`docs/web.md has no ${language} below "${heading}"`);
  return found[1];
};

/** None of those that systems give to a program that asks for any: another test may get such a port first. @returns {Promise<number>} */
const freePort = async () => {
  for (let k = 0; k < 100; ++k) {
    const port = 10000 + Math.floor(20000 * Math.random());
    const isFree = await new Promise(resolve => {
      const server = createTcp().once('error', () => resolve(false)).listen(port, '127.0.0.1', () => server.close(() => resolve(true)));
    });
    if (isFree) return port;
  }
  throw new Error('no port is free');
};

/** @param {number} port */
const listening = async port => {
  for (const end = Date.now() + 60000; Date.now() < end;) {
    const answered = await fetch(`http://127.0.0.1:${port}/`).then(() => true, () => false);
    if (answered) return;
    await new Promise(resolve => setTimeout(resolve, 50));
  }
  throw new Error(`nothing listens on port ${port}`);
};

/**
 * @typedef {object} Running
 * @property {{1: string, 2?: string}} urls by the version of HTTP
 * @property {() => {method: string, version: string, path: string, status: number, bytes: number}[]} log of requests for streams, so far
 * @property {() => void} [flush] brings it up to date, soon
 * @property {() => void} close
 */
/** @typedef {{folder: string, work: string, certificate: {key: string, cert: string}}} Place */

/** For tests alone: nobody trusts it. @param {string} work @returns {Place['certificate']} */
export const makeCertificate = work => {
  const [key, cert] = [join(work, 'key.pem'), join(work, 'cert.pem')];
  execFileSync('openssl', ['req', '-x509', '-newkey', 'ec', '-pkeyopt', 'ec_paramgen_curve:prime256v1', '-nodes', '-keyout', key,
                           '-out', cert, '-days', '2', '-subj', '/CN=127.0.0.1'], {stdio: 'ignore'});
  return {key, cert};
};

/** Lines of a log: method, protocol, status, bytes, path. @param {string} path */
const readLog = path => readFileSync(path, 'utf8').split('\n').filter(line => /\.l4d/.test(line)).map(line => {
  const [method, version, status, bytes, path] = line.split(' ');
  return {method, version, path, status: Number(status), bytes: Number(bytes)};
});

/** @param {string} program @param {string[]} args @param {number} port */
const run = async (program, args, port) => {
  const child = spawn(program, args, {stdio: ['ignore', 'ignore', 'pipe']});
  let said = '';
  child.stderr.on('data', data => { said += data; });
  const ended = new Promise((_, reject) => child.once('exit', code => reject(new Error(`${program} ended with ${code}: ${said}`))));
  ended.catch(() => {});
  await Promise.race([listening(port), ended]);
  return {said: () => said, flush: () => { child.kill('SIGHUP'); }, close: () => { child.kill(); }};
};

/** @param {Place} place @returns {Promise<Running>} */
export const nginx = async ({folder, work, certificate: {key, cert}}) => {
  const [plain, secure] = [await freePort(), await freePort()];
  const [config, log] = [join(work, 'nginx.conf'), join(work, 'nginx.log')];
  writeFileSync(config, `
daemon off; pid ${work}/nginx.pid; error_log stderr error; worker_processes 1;
events { worker_connections 64; }
http {
  types { text/html html; text/javascript js; application/wasm wasm; }
  log_format short '$request_method $server_protocol $status $body_bytes_sent $request_uri';
  access_log ${log} short;
  ${['client_body', 'proxy', 'fastcgi', 'uwsgi', 'scgi'].map(name => `${name}_temp_path ${work}/nginx-${name};`).join(' ')}
  server {
    listen 127.0.0.1:${plain}; listen 127.0.0.1:${secure} ssl http2;
    ssl_certificate ${cert}; ssl_certificate_key ${key};
    root ${folder};
    ${setting('#### nginx', 'nginx')}
  }
}`);
  const {close} = await run('nginx', ['-c', config, '-p', work], plain);
  return {urls: {1: `http://127.0.0.1:${plain}/`, 2: `https://127.0.0.1:${secure}/`}, log: () => readLog(log), close};
};

/** @param {Place} place @returns {Promise<Running>} */
export const lighttpd = async ({folder, work, certificate: {key, cert}}) => {
  const [plain, secure] = [await freePort(), await freePort()];
  const [config, log] = [join(work, 'lighttpd.conf'), join(work, 'lighttpd.log')];
  writeFileSync(config, `
server.modules += ("mod_openssl", "mod_accesslog")
server.document-root = "${folder}"
server.bind = "127.0.0.1"
server.port = ${plain}
mimetype.assign = (".html" => "text/html", ".js" => "text/javascript", ".wasm" => "application/wasm")
accesslog.filename = "${log}"
accesslog.format = "%m %H %s %B %U?%q"
$SERVER["socket"] == "127.0.0.1:${secure}" { ssl.engine = "enable" ssl.pemfile = "${cert}" ssl.privkey = "${key}" }
${setting('#### lighttpd', 'lighttpd')}`);
  const {flush, close} = await run('lighttpd', ['-D', '-f', config], plain);
  return {urls: {1: `http://127.0.0.1:${plain}/`, 2: `https://127.0.0.1:${secure}/`}, log: () => readLog(log), flush, close};
};

/** @param {Place} place @returns {Promise<Running>} */
export const python = async ({folder}) => {
  const port = await freePort();
  const {said, close} = await run('python3', ['-m', 'http.server', String(port), '--bind', '127.0.0.1', '--directory', folder], port);
  const log = () => [...said().matchAll(/"(\w+) (\S+\.l4d\S*) (\S+)" (\d+)/g)].map(([, method, path, version, status]) =>
    ({method, version, path, status: Number(status), bytes: 0}));
  return {urls: {1: `http://127.0.0.1:${port}/`}, log, close};
};

/** Over both versions of HTTP. @param {Place} place @param {(request: any, response: any) => void} answer @returns {Promise<Running>} */
const nodeServer = async ({certificate: {key, cert}}, answer) => {
  const seen = /** @type {any[]} */ ([]);
  const handle = (/** @type {any} */ request, /** @type {any} */ response) => {
    const of = {method: request.method, version: `HTTP/${request.httpVersion}`, path: request.url, status: 0, bytes: 0};
    if (/\.l4d/.test(request.url)) seen.push(of);
    response.on('finish', () => { of.status = response.statusCode; });
    answer(request, response);
  };
  const plain = createHttp(handle);
  const secure = createSecureServer({key: readFileSync(key), cert: readFileSync(cert)}, handle);
  const sessions = new Set();
  secure.on('session', session => sessions.add(session));
  const ports = [];
  for (const server of [plain, secure]) {
    await new Promise(resolve => server.listen(0, '127.0.0.1', () => resolve(undefined)));
    ports.push(/** @type {import('node:net').AddressInfo} */ (server.address()).port);
  }
  return {
    urls: {1: `http://127.0.0.1:${ports[0]}/`, 2: `https://127.0.0.1:${ports[1]}/`}, log: () => seen,
    close: () => {
      plain.closeAllConnections();
      for (const session of sessions) session.destroy();
      for (const server of [plain, secure]) server.close();
    }
  };
};

/** @param {Place} place */
export const serveStatic = async place => {
  const {default: handlerOf} = await import('serve-static');
  // What docs/web.md says, as it says it.
  const options = new Function(`return ${setting('#### serve-static', 'js')}`)();
  const handler = handlerOf(place.folder, options);
  return nodeServer(place, (request, response) => handler(request, response, () => { response.statusCode = 404; response.end(); }));
};

const types = /** @type {Record<string, string>} */ ({html: 'text/html', js: 'text/javascript', wasm: 'application/wasm'});
/** @param {Place} place @param {any} request */
const fileOf = ({folder}, request) => {
  const name = new URL(request.url, 'http://x').pathname.slice(1);
  try {
    return {bytes: readFileSync(join(folder, name)), type: types[name.split('.').at(-1) ?? ''] ?? 'binary/octet-stream',
            modified: statSync(join(folder, name)).mtime.toUTCString()};
  } catch {
    return null;
  }
};

/**
 * As S3 answers: CORS by rules, and only if there is an Origin; a preflight that no rule allows is refused; errors in XML.
 * @param {Place} place
 */
export const s3 = place => {
  const rules = JSON.parse(setting('#### S3', 'json'));
  return nodeServer(place, (request, response) => {
    const {origin, range} = request.headers;
    const rule = origin && rules.find((/** @type {any} */ r) => r.AllowedOrigins.some((/** @type {string} */ o) => o === '*' || o === origin) &&
      r.AllowedMethods.includes(request.headers['access-control-request-method'] ?? request.method));
    const headers = /** @type {Record<string, any>} */ ({Server: 'AmazonS3', 'x-amz-request-id': '0A1B2C3D4E5F6071'});
    if (rule) {
      const exposed = rule.ExposeHeaders ?? [];
      Object.assign(headers, {'Access-Control-Allow-Origin': '*', 'Access-Control-Allow-Methods': rule.AllowedMethods.join(', '),
                              ...exposed.length > 0 && {'Access-Control-Expose-Headers': exposed.join(', ')},
                              Vary: 'Origin, Access-Control-Request-Headers, Access-Control-Request-Method'});
    }
    const refuse = (/** @type {number} */ status, /** @type {string} */ code) => response.writeHead(status, {
      ...headers, 'Content-Type': 'application/xml'}).end(`<?xml version="1.0" encoding="UTF-8"?>\n<Error><Code>${code}</Code></Error>`);
    const asked = request.headers['access-control-request-headers']?.split(/, */) ?? [];
    if (request.method === 'OPTIONS') {
      const allowed = rule?.AllowedHeaders ?? [];
      if (!asked.every((/** @type {string} */ name) => allowed.includes('*') || allowed.includes(name))) return refuse(403, 'AccessForbidden');
      return response.writeHead(200, headers).end();
    }
    const file = fileOf(place, request);
    if (!file) return refuse(404, 'NoSuchKey');
    const [, first, last] = /^bytes=(\d+)-(\d*)$/.exec(range ?? '') ?? [];
    const begin = Number(first ?? 0), end = Math.min(last ? Number(last) + 1 : file.bytes.length, file.bytes.length);
    if (begin >= end) return refuse(416, 'InvalidRange');
    response.writeHead(range ? 206 : 200, {
      ...headers, 'Accept-Ranges': 'bytes', ETag: '"9b2cf535f27731c974343645a3985328"', 'Last-Modified': file.modified,
      'Content-Type': file.type, 'Content-Length': end - begin,
      ...range && {'Content-Range': `bytes ${begin}-${end - 1}/${file.bytes.length}`}
    }).end(file.bytes.subarray(begin, end));
  });
};

/**
 * As a CDN that compresses whatever passes it: whole files, of no stated length, with weak tags, whatever is wanted of them.
 * @param {Place} place
 */
export const cdn = place => nodeServer(place, (request, response) => {
  const file = fileOf(place, request);
  const headers = {'Access-Control-Allow-Origin': '*', Vary: 'Accept-Encoding', Via: '1.1 edge', Age: '7'};
  if (!file || request.method !== 'GET') return response.writeHead(file ? 405 : 404, headers).end();
  response.writeHead(200, {...headers, 'Content-Type': file.type, 'Content-Encoding': 'gzip', ETag: 'W/"5f3c-61a"',
                           'Last-Modified': file.modified});
  const packed = createGzip();
  packed.pipe(response);
  packed.end(file.bytes);
});
