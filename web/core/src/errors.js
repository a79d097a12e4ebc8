// SPDX-License-Identifier: Apache-2.0

/**
 * What opening, seeking and slicing fail with. `code`: a status of the library without its prefix
 * ("CORRUPT", "NOT_L4D", "INVALID_ARGUMENT"), or "NETWORK", "HTTP", "CHANGED" (another file lies at the URL now),
 * "ABORTED".
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

/** @param {string} [why] */
export const abortError = (why = 'aborted') => new DOMException(why, 'AbortError');
