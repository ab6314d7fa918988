// Whether a file is the journal of systemd, as JOURNAL_STREAM tells (systemd.exec(5)).
#pragma once

namespace fxagent::log {

/// Device and inode of the open file `handle` are those that JOURNAL_STREAM names. It is false for
/// a file that was redirected although the variable was inherited. Any thread.
bool is_journal_stream(int handle);

}  // namespace fxagent::log
