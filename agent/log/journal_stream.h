// Detects the journal of systemd by JOURNAL_STREAM (systemd.exec(5)).
#pragma once

namespace fxagent::log {

/// True if device and inode of the open file `handle` are those in JOURNAL_STREAM. False for a file
/// that was redirected, even if the variable was inherited. Any thread.
bool is_journal_stream(int handle);

}  // namespace fxagent::log
