// Interposes connect() and poll(), so that Paho notices at once when a connection is up. Its
// receiving thread waits up to 1 s for something to read before it checks whether a new socket is
// connected, and does not include a socket that is created while it waits
// (Socket_getReadySocket). A connect could take 1 s longer, and with other connections 2 s.
#pragma once

namespace fxagent {

/// True on a thread of Paho.
bool is_paho_thread() noexcept;

/// Forgets a socket, because Paho has read the outcome of its connect(). Any thread.
void note_connect_outcome(int fd) noexcept;

}  // namespace fxagent
