// The lease of a standby pair: at most one of two members is on the wire.
//
// Time is a number of ticks and passes at any moment, so a member, the broker or a message may be late without limit:
// every pause, partition and restart is included, and none is counted. Only an exchange is bounded: after L ticks the
// wire is silent. Members compare durations only, so the offset of their clocks does not matter.
//
// Each age stops growing where a larger value no longer matters. This keeps the state space finite.
//
// Macros: Q and L in ticks, PAUSE_MAX, and the mutations listed in README.md.

#ifndef Q
#define Q 6
#endif
#define HALF (Q / 2)
#ifndef L
#define L (HALF - 1)
#endif
#define OLD (HALF + 1)  // an age that is too high for a lease

// Real time lies between ticks. `age <= HALF` in ticks is the closed form of `age < Q/2` in real time: a begin just
// before Q/2 and one at Q/2 are the same tick.
#ifdef NO_LEASE_CHECK
#define LEASE_VALID(m) true
#else
#define LEASE_VALID(m) (lease_age[m] <= HALF)
#endif
#ifdef NO_WAIT
#define WAITED(m) true
#else
#define WAITED(m) (to_wait[m] == 0)
#endif

#define NOBODY 2
#define OTHER(m) (1 - m)

// `acting` is the active member: `active` is a word of Promela.
mtype = { standby, claiming, waiting, acting };
mtype = { none, connect, connack, heartbeat, puback };

mtype role[2] = standby;
// The one packet that a member and the broker have between them, in either direction.
mtype net[2] = none;
byte session = NOBODY;  // the member whose connection has the pair's client id
bool stamped[2];        // the time of the next heartbeat is read
byte stamp_age[2] = OLD;
byte lease_age[2] = OLD;
byte to_wait[2];        // remaining ticks of the claimant's wait
byte wire[2];               // remaining ticks of an exchange
byte since_begin[2] = OLD;  // age of the last request
bool asleep[2];             // the machine sleeps: mutation CLOCK_STOPS
bool checked[2];            // between the check of the lease and the write: mutation SPLIT_CHECK
byte check_age[2];
byte handovers;  // for REACH
byte last = NOBODY;

inline forget_connection(m) {
  net[m] = none;
  stamped[m] = false;
  stamp_age[m] = OLD;
#ifndef KEEP_LEASE
  lease_age[m] = OLD;
#endif
}

inline begin_exchange(m) {
  wire[m] = L;
  assert(wire[OTHER(m)] == 0);
#ifndef SPLIT_CHECK
  assert(since_begin[OTHER(m)] >= HALF);
#endif
  since_begin[m] = 0;
#ifdef REACH
  if
  :: last != m -> handovers++; last = m
  :: else
  fi;
  assert(handovers < 3)
#endif
}

#define RUNS(m) (!asleep[m])

proctype member(bit me) {
  do
  // The standby may claim at any moment. A false alarm is as good as a real one.
  :: d_step { RUNS(me) && role[me] == standby ->
       forget_connection(me); net[me] = connect; to_wait[me] = Q; role[me] = claiming }
  :: d_step { RUNS(me) && role[me] == claiming && net[me] == connack ->
       net[me] = none; role[me] = waiting }
  :: d_step { RUNS(me) && role[me] == waiting && WAITED(me) -> role[me] = acting; to_wait[me] = 0 }

  // A heartbeat: read the clock, then send.
#ifdef STAMP_AFTER_SEND
  :: d_step { RUNS(me) && (role[me] == waiting || role[me] == acting) && net[me] == none && !stamped[me] ->
       net[me] = heartbeat }
  :: d_step { RUNS(me) && (net[me] == heartbeat || net[me] == puback) && !stamped[me] ->
       stamped[me] = true; stamp_age[me] = 0 }
#else
  :: d_step { RUNS(me) && (role[me] == waiting || role[me] == acting) && net[me] == none && !stamped[me] ->
       stamped[me] = true; stamp_age[me] = 0 }
  :: d_step { RUNS(me) && stamped[me] && net[me] == none -> net[me] = heartbeat }
#endif
  :: d_step { RUNS(me) && net[me] == puback && stamped[me] ->
       net[me] = none; stamped[me] = false;
#ifdef LEASE_FROM_ACK
       lease_age[me] = 0;
#else
       lease_age[me] = stamp_age[me];
#endif
       stamp_age[me] = OLD }

#ifdef SPLIT_CHECK
  :: d_step { RUNS(me) && role[me] == acting && LEASE_VALID(me) && wire[me] == 0 && !checked[me] ->
       checked[me] = true; check_age[me] = 0 }
  :: d_step { RUNS(me) && checked[me] -> checked[me] = false; check_age[me] = 0; begin_exchange(me) }
#else
  :: d_step { RUNS(me) && role[me] == acting && LEASE_VALID(me) && wire[me] == 0 -> begin_exchange(me) }
#endif

  // The member sees that its connection is gone, or gives it up. Its exchange goes on.
  :: d_step { RUNS(me) && role[me] != standby && !checked[me] -> forget_connection(me);
#ifdef RECONNECT_WITHOUT_WAIT
       if
       :: role[me] == acting -> net[me] = connect
       :: else -> role[me] = standby; to_wait[me] = 0
       fi
#else
       role[me] = standby; to_wait[me] = 0
#endif
     }
#ifdef RECONNECT_WITHOUT_WAIT
  :: d_step { RUNS(me) && role[me] == acting && net[me] == connack -> net[me] = none }
#endif
#ifdef CLOCK_STOPS
  :: asleep[me] = !asleep[me]
#endif
  od
}

// The broker's side of one member. Delivers packets whenever it likes, and loses connections whenever it likes: a crash, a restart, a lost session.
proctype broker(bit m) {
  do
  :: d_step { net[m] == connect -> session = m; net[m] = connack }
#ifdef NO_TAKEOVER
  :: d_step { net[m] == heartbeat -> net[m] = puback }
#else
  :: d_step { net[m] == heartbeat && session == m -> net[m] = puback }
#endif
  :: d_step { session == m -> session = NOBODY }
  od
}

#define GROW(age, m) \
  if \
  :: age[m] < OLD && RUNS(m) -> age[m]++ \
  :: else \
  fi
#define GROW_ALWAYS(age, m) \
  if \
  :: age[m] < OLD -> age[m]++ \
  :: else \
  fi
#define DRAIN(left, m) \
  if \
  :: left[m] > 0 -> left[m]-- \
  :: else \
  fi
#ifdef WAIT_FROM_CONNECT
#define WAIT_PASSES(m) (role[m] == claiming || role[m] == waiting)
#else
#define WAIT_PASSES(m) (role[m] == waiting)
#endif

#ifdef PAUSE_MAX
#define TICK_IS_FREE(m) (!checked[m] || check_age[m] < PAUSE_MAX)
#else
#define TICK_IS_FREE(m) true
#endif

inline pass(m) {
  GROW(stamp_age, m);
  GROW(lease_age, m);
  if
  :: WAIT_PASSES(m) && RUNS(m) -> DRAIN(to_wait, m)
  :: else
  fi;
#ifdef PAUSE_MAX
  if
  :: checked[m] -> check_age[m]++
  :: else
  fi;
#endif
  GROW_ALWAYS(since_begin, m);
  DRAIN(wire, m)
}

proctype timer() {
  do
  :: d_step { TICK_IS_FREE(0) && TICK_IS_FREE(1) -> pass(0); pass(1) }
  od
}

init {
  atomic { run member(0); run member(1); run broker(0); run broker(1); run timer() }
}
