/* Bounds of the latch board's core. A port may lower them to save RAM, by -D or in its
 * own header; those of the protocol (docs/serial-protocol.md) are the largest. */
#ifndef LB_CONFIG_H
#define LB_CONFIG_H

/* Encoders, section 4: 0 to 32. */
#ifndef LB_MAX_CHANNELS
#define LB_MAX_CHANNELS 32U
#endif

/* Inputs, section 4: up to 8, one bit each. */
#ifndef LB_MAX_INPUTS
#define LB_MAX_INPUTS 8U
#endif

/* Timed samples that wait for the main loop; when full, the sample counts as dropped. */
#ifndef LB_SAMPLE_QUEUE
#define LB_SAMPLE_QUEUE 16U
#endif

/* Changes of inputs that wait for the main loop; when full, the next is latched late. */
#ifndef LB_CHANGE_QUEUE
#define LB_CHANGE_QUEUE 8U
#endif

/* Alarms of the port that wait for room in the line. */
#ifndef LB_ALARM_QUEUE
#define LB_ALARM_QUEUE 4U
#endif

/* Edges kept until they are acknowledged, section 4. */
#define LB_MAX_EDGES 16U

/* Temperatures, section 4. */
#define LB_MAX_TEMPERATURES 16U

_Static_assert(LB_MAX_CHANNELS >= 1U && LB_MAX_CHANNELS <= 32U, "1 to 32 channels");
_Static_assert(LB_MAX_INPUTS >= 1U && LB_MAX_INPUTS <= 8U, "1 to 8 inputs");
_Static_assert(LB_SAMPLE_QUEUE >= 2U && LB_SAMPLE_QUEUE <= 128U, "2 to 128 samples");
_Static_assert(LB_CHANGE_QUEUE >= 2U && LB_CHANGE_QUEUE <= 128U, "2 to 128 changes");

#endif
