// SPDX-License-Identifier: Apache-2.0

/**
 * What opening, seeking and slicing fail with, unless they are aborted (abortError). `code`: a status of the library
 * without its prefix ("CORRUPT", "NOT_L4D", "INVALID_ARGUMENT"), or
 * "NETWORK" (no answer, or one that was not finished), "NOT_FOUND" (status 404 or 410), "HTTP" (another status),
 * "NO_RANGES" (the server does not answer with the parts of the file that are wanted), "REQUEST" (what the page gave as `request`
 * fails), "CHANGED" (another file lies at the URL now), "PLAYLIST", "WEBGL2" (the browser has none),
 * "INTERNAL".
 */
export class L4DError extends Error {
  /**
   * @param {string} code
   * @param {string} message
   * @param {{clause?: string, offset?: number}} [where] the rule that a stream breaks, and the byte
   */
  constructor(code, message, where = {}) {
    super(message);
    this.name = 'L4DError';
    this.code = code;
    this.clause = where.clause ?? '';
    this.offset = where.offset ?? -1;
  }

  /** @param {string} name "L4D_ERR_CORRUPT" @param {string} detail what the library says */
  static fromStatus(name, detail) {
    const code = name.replace(/^L4D_ERR_/, '');
    const clause = /^(?:spec )?([A-Z]+-\d+)\b/.exec(detail)?.[1];
    const offset = /\bat byte (\d+)/.exec(detail)?.[1];
    return new L4DError(code, detail || name,
                        {clause, offset: offset === undefined ? undefined : Number(offset)});
  }

  /** @param {{code: string, message: string, clause: string, offset: number}} data */
  static fromData(data) { return new L4DError(data.code, data.message, data); }

  /** What can be sent between threads. @param {unknown} error */
  static toData(error) {
    const e = /** @type {any} */ (error);
    const aborted = e?.name === 'AbortError';
    return {
      code: e instanceof L4DError ? e.code : aborted ? 'ABORTED' : 'INTERNAL',
      message: String(e?.message ?? e),
      clause: e?.clause ?? '',
      offset: e?.offset ?? -1
    };
  }
}

/** The error for an answer without bytes of the file. @param {string} url @param {number} status */
export const statusError = (url, status) => {
  if (status >= 500 || status === 408 || status === 429) return new L4DError('NETWORK', `${url}: status ${status}`);
  if (status === 404 || status === 410) return new L4DError('NOT_FOUND', `${url}: status ${status}; check the address`);
  const why = status === 401 || status === 403 ? '; it may want `headers`, `credentials` or a `request` that signs, which open() takes' : '';
  return new L4DError('HTTP', `${url}: status ${status}${why}`);
};

/** Of a page that is no page of a server. @param {string} fault */
export const fileError = fault =>
  new L4DError('INTERNAL', `a page that is opened as a file ${fault}; put it on a web server (python3 -m http.server is one)`);

/** Of a request without an answer. @param {string} url @param {any} error of fetch() @param {string[]} [headers] of the page */
export const fetchError = (url, error, headers = []) => {
  const {origin} = globalThis.location ?? {};
  if (url.startsWith('file:')) return fileError('reads no other files');
  // Browsers do not say which it was.
  const why = !origin || origin !== 'null' && new URL(url, origin).origin === origin ? '' :
    '; a server of another origin must also allow this page to read the file (Access-Control-Allow-Origin)' +
    (headers.length > 0 ? ` and to send ${headers.join(', ')} (Access-Control-Allow-Headers, in the answer to OPTIONS)` : '');
  return Object.assign(new L4DError('NETWORK', `${url}: ${error?.message ?? error}${why}`), {cause: error});
};

/** What browsers fail with when something is aborted. @param {string} [why] */
export const abortError = (why = 'aborted') => new DOMException(why, 'AbortError');
