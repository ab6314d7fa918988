// Interposes connect() and poll(), so that Paho notices at once that a connection stands. Its
// receiving thread waits up to 1 s for something to read before it looks whether a new socket is
// connected, and does not even wait for a socket that was made during its wait
// (Socket_getReadySocket). Each connect would take 1 s longer.
#pragma once

namespace fxagent {

/// True on a thread of Paho.
bool is_paho_thread() noexcept;

/// Paho has asked for the outcome of the connect() of this socket. Any thread.
void note_connect_outcome(int fd) noexcept;

}  // namespace fxagent
