// Puts the samples of one device in the order of `seq` (interface.md, section 4, Sequence numbers).
// After an outage history arrives among newer live samples, and a sample may arrive twice. A sample waits here until
// all earlier ones are out. If they do not come, the owner calls release().
"use strict";

const MAX_HELD = 100000;  // samples
const MAX_GAPS = 1000;

class Order {
    /** `out(row)` takes the samples in order. A row may get `late` or `missing`, see add(). */
    constructor(out) {
        this.out = out;
        this.boot = null;       // of the newest live sample
        this.next = null;       // the next number; null: none was seen yet
        this.last = null;       // boot of the last row that is out
        this.held = new Map();  // seq → row, all above `next`
        this.gaps = [];         // [from, to]: numbers below `next` that did not come
    }

    /**
     * Takes a sample. `history`: it came as history. Returns false for a repeated one, which is dropped.
     * A row that comes after a release for its number has `late`. The first row after a gap within one boot has
     * `missing`, the number of samples that did not come.
     */
    add(row, history) {
        const seq = row.seq;
        if (!history) {
            // Without its store the agent may count from an earlier number after a restart.
            if (this.boot !== null && row.boot !== this.boot && seq < this.next) {
                this.release();
                this.next = null;
            }
            this.boot = row.boot;
        }
        if (this.next === null) {
            this.next = seq;
            this.gaps = [[0, seq - 1]];
        }
        if (seq < this.next) {
            if (!this.fill(seq)) return false;
            this.out({...row, late: true});
        } else if (seq > this.next) {
            if (this.held.has(seq)) return false;
            this.held.set(seq, row);
            if (this.held.size > MAX_HELD) this.skip();
        } else {
            this.pass(row);
            this.drain();
        }
        return true;
    }

    /** True if samples wait for earlier ones. */
    get waits() {
        return this.held.size > 0;
    }

    /** Sends all waiting samples, in order. Their gaps count as missing. */
    release() {
        const rows = [...this.held.values()].sort((a, b) => a.seq - b.seq);
        this.held.clear();
        for (const row of rows) this.pass(row);
    }

    // Sends a row. The numbers between the last row and this one are a gap.
    pass(row) {
        const missing = row.seq - this.next;
        if (missing > 0) this.gaps.push([this.next, row.seq - 1]);
        if (this.gaps.length > MAX_GAPS) this.gaps.shift();
        this.next = row.seq + 1;
        // With a new boot the numbers may skip forward.
        const counts = missing > 0 && row.boot === this.last;
        this.last = row.boot;
        this.out(counts ? {...row, missing} : row);
    }

    drain() {
        for (let row; (row = this.held.get(this.next)) !== undefined;) {
            this.held.delete(row.seq);
            this.pass(row);
        }
    }

    // Ends the wait for the oldest gap.
    skip() {
        let first = Infinity;
        for (const seq of this.held.keys()) first = Math.min(first, seq);
        const row = this.held.get(first);
        this.held.delete(first);
        this.pass(row);
        this.drain();
    }

    // Removes a number from the gaps. False if it is in none: the sample was here before.
    fill(seq) {
        const at = this.gaps.findIndex(([from, to]) => from <= seq && seq <= to);
        if (at < 0) return false;
        const [from, to] = this.gaps[at];
        this.gaps.splice(at, 1, ...[[from, seq - 1], [seq + 1, to]].filter(([a, b]) => a <= b));
        return true;
    }
}

module.exports = {Order};
